"""Generators by name: the shipped ones, models in folders, and plugins."""

from pd_editor.generation.generators.registry import (
    DEFAULT_GENERATOR,
    GENERATORS,
    MODEL_CONFIG,
    SHIPPED_MODEL,
    GeneratorCatalogue,
    UnusableGenerator,
    catalogue_with,
    is_generator,
    make_generator,
    shipped_models,
)

__all__ = [
    "DEFAULT_GENERATOR",
    "GENERATORS",
    "MODEL_CONFIG",
    "SHIPPED_MODEL",
    "GeneratorCatalogue",
    "UnusableGenerator",
    "catalogue_with",
    "is_generator",
    "make_generator",
    "shipped_models",
]
