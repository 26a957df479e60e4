"""Guidance terms in numbers: can they be met, were they met, and at what cost."""
