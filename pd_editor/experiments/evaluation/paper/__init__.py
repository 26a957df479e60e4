"""The paper's tables and figures, from evaluations of all systems."""
