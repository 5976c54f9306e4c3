"""Results as types: of one flight, of one craft over several flights, of a whole folder."""
