"""Configuration of training runs: settings, presets, requests."""
