"""SUMO's command line tools and files: nets, floating-car data, signal plans."""
