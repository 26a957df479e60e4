"""The editor without its view: commands, history, session, recipe and journal."""
