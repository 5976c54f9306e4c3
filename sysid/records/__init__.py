"""Experiments: records of inputs and outputs on one clock, and how they are cut from a flight or a table."""
