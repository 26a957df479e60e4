"""Errors, texts and files, which everything else may use."""
