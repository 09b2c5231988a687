"""Metrics, matching, statistics: pure functions on arrays."""
