"""The account of a flight: readings that anyone can check in a viewer, what happened, and the story that it makes."""

from pipeline.flight.account.account import account_of_flight, account_of_log

__all__ = ["account_of_flight", "account_of_log"]
