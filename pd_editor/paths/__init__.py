"""Where an agent could drive."""
