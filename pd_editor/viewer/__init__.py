"""The browser view; viser is used only here."""
