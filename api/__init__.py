"""The web service: uploads in, models and reports out."""
