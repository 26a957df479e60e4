"""The control panels, one module each."""
