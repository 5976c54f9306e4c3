"""Text as a cell of CSV: names come from files and logs, and a spreadsheet calculates what looks like a formula."""

#: First characters of what a spreadsheet calculates (OWASP, CSV injection).
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def as_cell(text: str) -> str:
    """Return text that a spreadsheet shows as it is: what it would take for a formula gets an apostrophe before it."""
    return f"'{text}" if text.startswith(_FORMULA) else text
