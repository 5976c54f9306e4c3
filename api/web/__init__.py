"""HTTP itself: what routes are given, uploads, pages and errors as answers, headers."""
