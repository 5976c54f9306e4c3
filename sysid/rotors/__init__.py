"""Rotors from flight: thrust curve, torque, and the methods of the source papers."""
