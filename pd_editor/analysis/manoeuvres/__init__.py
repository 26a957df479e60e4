"""What happens in a scene: manoeuvres of agents, and what pairs of them do."""
