"""What belongs to a flight and not to the craft: wind, thrust scale, and how they wander."""
