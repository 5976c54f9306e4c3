"""Simulation: vehicles with known truth, flown, sensed and logged."""
