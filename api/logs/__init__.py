"""Logs and their analyses: received, listed, followed, cleared away."""
