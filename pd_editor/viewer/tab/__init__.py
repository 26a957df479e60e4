"""Parts of a browser tab: picture, modes, control panel, tools, hot keys, menus."""
