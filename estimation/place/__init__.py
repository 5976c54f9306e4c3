"""Where a log was flown: its local frame, the Earth's magnetic field, and what the world is like there."""
