"""What a scene shows: metrics, findings, repairs, guidance terms and threats."""
