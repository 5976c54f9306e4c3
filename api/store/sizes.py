"""Numbers of bytes as people write them."""

from pydantic import ByteSize


def in_words(count: int) -> str:
    """Write a number of bytes in the largest unit that fits: ``1 GB``, ``3.2 MB``."""
    return ByteSize(count).human_readable(decimal=True, separator=" ").replace(".0 ", " ").replace("KB", "kB")
