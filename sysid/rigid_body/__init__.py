"""The rigid body from flight: translation, rotation, wind, trim, hover and the simulator frame."""
