"""State of a browser tab: workspace, playhead, message queue, user interface context."""
