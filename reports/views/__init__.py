"""Words and tables that pages show of a result."""
