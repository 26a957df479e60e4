"""The networks once more, in fewer operations."""
