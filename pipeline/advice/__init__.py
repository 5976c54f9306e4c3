"""How to fly and log better next time."""
