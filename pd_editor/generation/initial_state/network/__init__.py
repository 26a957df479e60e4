"""The initial-state network: inputs, encoding, layers, denoiser."""
