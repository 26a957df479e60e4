"""Making a road harder on purpose."""
