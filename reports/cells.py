"""Text as a cell of CSV: names come from files and logs, and a spreadsheet calculates what looks like a formula."""

#: First characters of what a spreadsheet calculates (OWASP, CSV injection).
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def as_cell(value: object) -> object:
    """Return what a spreadsheet shows as it is: text that it would take for a formula gets an apostrophe before it."""
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value
