"""The craft and flights of the source papers."""
