"""What is opened, kept and exported."""
