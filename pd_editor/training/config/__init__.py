"""What a training run is asked to do: settings, presets, requests."""
