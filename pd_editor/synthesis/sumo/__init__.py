"""SUMO's tools and files: net files, floating-car data, signal plans, speed limits."""
