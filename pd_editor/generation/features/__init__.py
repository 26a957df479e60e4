"""Input features of the networks: map tokens, agents, and their store on disk."""
