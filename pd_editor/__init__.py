"""Path Diffuser Editor: traffic scenarios on real and perturbed roads."""
