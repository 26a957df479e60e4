"""How near synthetic scenes come to recorded ones."""
