"""Speed and accuracy against the peers, measured in one run and quoted as ratios."""
