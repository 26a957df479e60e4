"""The first stage: initial states of agents on a map."""
