"""Estimation: canonical tables to a trajectory with honest uncertainty."""
