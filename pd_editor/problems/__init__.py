"""What is wrong with a scenario, in one list of values with a sentence each."""
