"""What a browser tab works on and with: workspace, playhead, queue, context."""
