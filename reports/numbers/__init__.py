"""What files hold: typed results as JSON, compared, and read again."""
