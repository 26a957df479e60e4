"""Training data: scenes, augmentation, prepared features, batches."""
