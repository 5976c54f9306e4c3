"""Models against held-out flights: free run, horizons, baselines, verdicts, choice of order."""
