"""Names of files as text that every page, table and terminal can take."""


def printable(text: str) -> str:
    r"""Write what of a file name is not UTF-8 as ``\xff``; all else stays as it is.

    Python carries such bytes as lone surrogates, which no UTF-8 file can hold.
    """
    try:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # a surrogate that stands for no byte, such as Windows allows in names
        return text.encode("utf-8", "backslashreplace").decode("utf-8")
