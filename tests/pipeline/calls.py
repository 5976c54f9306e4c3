"""Calls for other processes, which meet the test through named pipes: opening one waits for the other side."""

import os
import signal
import tempfile
from pathlib import Path


def square(number: int) -> int:
    return number * number


def environment(name: str) -> str | None:
    return os.environ.get(name)


def fetched_logs() -> list[str]:
    return [str(path) for path in Path(tempfile.gettempdir()).rglob("*.bin")]


def refuse(reason: str) -> None:
    raise ValueError(reason)


def unsendable() -> object:
    return lambda: None


def stay(pipe: Path) -> None:
    """Return the own process id and stay until killed; the pipe ends with the process."""
    with pipe.open("w") as reports:
        reports.write(f"{os.getpid()}\n")
        reports.flush()
        signal.pause()


def stay_at_first(task: tuple[Path, int]) -> str:
    """Stay until killed where the number is 2, but not a second time."""
    folder, number = task
    if number != 2:
        return "done"
    marker = folder / "tried"
    if not marker.exists():
        marker.touch()
        stay(folder / "pipe")
    return "done"


def die_or_note(task: tuple[Path, str]) -> str:
    """Write down when it begins and ends; die if that is its name."""
    diary, name = task
    _note(diary, f"{name} begins")
    if name == "poison":
        _note(diary, "poison ends")
        os.kill(os.getpid(), signal.SIGKILL)
    _note(diary, f"{name} ends")
    return name


def _note(diary: Path, line: str) -> None:
    with diary.open("a") as file:
        file.write(f"{line}\n")
