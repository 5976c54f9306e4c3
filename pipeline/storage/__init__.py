"""Where logs come from and where results are kept."""
