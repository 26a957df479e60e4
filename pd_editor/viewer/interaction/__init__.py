"""Mouse, camera and gizmos: from events on the canvas to commands."""
