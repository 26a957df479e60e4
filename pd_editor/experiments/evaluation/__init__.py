"""Evaluation of generators on many scenes: rows per agent, tables, a report."""
