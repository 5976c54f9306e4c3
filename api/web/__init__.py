"""HTTP itself: what routes are given, pages and errors as answers, headers, the reference."""
