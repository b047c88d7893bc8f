"""What several tests or benchmarks share."""
