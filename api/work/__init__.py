"""From an order to its results: the queue, whoever works, and what an analysis hands over."""
