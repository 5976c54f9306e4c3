"""Recommendations for the next flight: what to log and what to fly."""
