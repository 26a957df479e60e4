"""Loss of a network's own samples, differentiated through the last denoising steps."""
