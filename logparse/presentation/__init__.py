"""How results show themselves: numbers with units, tables, a few lines."""
