"""The equations of motion, and what they read of a flight."""
