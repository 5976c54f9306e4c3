"""How healthy a flight was, and how well it was logged."""
