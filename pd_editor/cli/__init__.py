"""One small main per shell command."""
