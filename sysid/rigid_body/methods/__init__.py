"""How parameters are fitted to flights: equation, output and filter error, the law of drag."""
