"""Names of files as text that every page, table and terminal can take, and as folders that every file system can."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit


def printable(text: str) -> str:
    r"""Write what of a file name is not UTF-8 as ``\xff``, and control characters as ``\x1b``; all else stays as it is.

    Python carries such bytes as lone surrogates, which no UTF-8 file can hold. Control characters would command the
    terminal that shows them; lines and tabs stay.
    """
    try:
        text = text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # a surrogate that stands for no byte, such as Windows allows in names
        text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return _CONTROL.sub(lambda match: f"\\x{ord(match[0]):02x}", text)


#: C0 and C1 control characters but for tab and newline.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")


def is_url(place: str | Path) -> bool:
    """Report a URL from a path; one letter before the colon is a drive of Windows."""
    return not isinstance(place, Path) and "://" in place and len(urlsplit(place).scheme) > 1


def file_name(url: str) -> str:
    """Return the last part of a path or URL, as text that can be shown."""
    return printable(PurePosixPath(urlsplit(url).path).name if is_url(url) else Path(url).name)


def folder_names(names: Iterable[str], known: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return every flight a folder name that any file system takes, unique without regard to case."""
    names = list(names)
    folders = {name: folder for name, folder in (known or {}).items() if name in names}
    taken = {folder.casefold() for folder in folders.values()}
    for name in names:
        if name in folders:
            continue
        base = re.sub(r"[^\w.()+-]+", "_", name).strip("._")
        # File systems count bytes, of which a letter may have four.
        # Longest name of a folder, bytes: file systems take 255, and something stands before and behind it.
        base = base.encode()[:120].decode(errors="ignore") or "flight"
        if not re.search(r"[^\W\d_]", base):
            base = f"log_{base}"  # query engines take what looks like a number or a date for one
        folder, number = base, 1
        while folder.casefold() in taken:
            number += 1
            folder = f"{base}_{number}"
        taken.add(folder.casefold())
        folders[name] = folder
    return {name: folders[name] for name in names}


def flight_name(log: str, number: int, count: int) -> str:
    """Name a flight after its log; where that holds several, with the flight's number."""
    return log if count == 1 else f"{log}#{number}"


def flight_folder(log: str, number: int) -> str:
    """Name the folder of a flight after that of its log; ``~`` is in no folder name of `folder_names`."""
    return log if number == 1 else f"{log}~{number}"
