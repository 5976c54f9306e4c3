"""Bench tests: thrust stand and bifilar pendulum."""
