"""One module per format, each from a scenario to files."""
