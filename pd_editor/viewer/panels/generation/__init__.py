"""The generation panel with its parts: runs, candidates, live regeneration."""
