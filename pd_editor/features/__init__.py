"""What the networks see of a scene: map tokens, agents, and their store on disk."""
