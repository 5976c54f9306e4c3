"""Identification: experiments to models, and models to honest verdicts."""
