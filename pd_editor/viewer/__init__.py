"""The browser view, the only package that uses viser."""
