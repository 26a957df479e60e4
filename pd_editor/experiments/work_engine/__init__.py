"""Parallel execution of many work items on local processes or a Ray cluster."""
