"""Craft of an owner: their flights, models, reviews, alerts and webhooks."""
