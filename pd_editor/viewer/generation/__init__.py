"""Traffic that is generated: candidates, runs, samples, live reactions."""
