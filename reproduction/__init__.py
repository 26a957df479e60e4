"""The paper's systems, tables, claims and figures, made with the package."""
