"""Physical parameters followed over the flights of a craft."""
