"""Many logs: flights of one craft identified jointly and followed over time."""
