"""The web server and its protection against foreign pages and large messages."""
