"""Writing exported files as a zip or a folder."""
