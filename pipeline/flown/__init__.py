"""What a flight covered, how well it was logged, and the envelope that several flights make."""
