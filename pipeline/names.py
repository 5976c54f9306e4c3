"""Names of files as text that every page, table and terminal can take, and as folders that every file system can."""

import re


def printable(text: str) -> str:
    r"""Write what of a file name is not UTF-8 as ``\xff``; all else stays as it is.

    Python carries such bytes as lone surrogates, which no UTF-8 file can hold.
    """
    try:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # a surrogate that stands for no byte, such as Windows allows in names
        return text.encode("utf-8", "backslashreplace").decode("utf-8")


def folder_names(names: list[str]) -> dict[str, str]:
    """Give every flight a folder name that any file system takes, unique without regard to case."""
    folders: dict[str, str] = {}
    for name in names:
        base = re.sub(r"[^\w.()+-]+", "_", name).strip("._")[:100] or "flight"
        folder, number = base, 1
        while folder.casefold() in (other.casefold() for other in folders.values()):
            number += 1
            folder = f"{base}_{number}"
        folders[name] = folder
    return folders
