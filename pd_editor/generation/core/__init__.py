"""Common parts of both stages: noise schedules, sampler, attention."""
