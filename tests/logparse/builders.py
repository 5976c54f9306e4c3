"""Canonical tables from messages that a test makes up."""

from logparse.canonical import gather_tables
from logparse.craft.vehicle import describe


def tables_of(messages, kind, parameters):
    """Return the canonical tables of messages, and what was left out or assumed for them."""
    vehicle = describe(messages, format=kind, parameters=parameters)
    tables, findings = gather_tables(messages, format=kind, parameters=parameters, vehicle=vehicle)
    return tables, findings()
