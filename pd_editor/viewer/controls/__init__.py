"""What acts on the whole tab: panel, tools, keys, menus."""
