"""Detection of problems in a scenario, each with a sentence for the user."""
