"""The rule-based baseline generator: follow a lane, keep a gap."""
