"""The account of a flight: readings that anyone can check in a viewer, what happened, and the story that it makes."""

from pipeline.flight.account.account import tell, tell_each

__all__ = ["tell", "tell_each"]
