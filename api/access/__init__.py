"""Who asks, how much they may send, and which keys open what."""
