"""What is wrong with the scene, and what helps."""
