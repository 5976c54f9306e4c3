"""Compiled functions and what they are made of; splines; results kept for a moment."""
