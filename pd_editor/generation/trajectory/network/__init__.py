"""The trajectory network: inputs, layers, denoiser, decoding of its latents."""
