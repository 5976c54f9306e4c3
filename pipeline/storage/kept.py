"""Results kept beside their products, so that pages of them can be drawn anew without analysing again.

A result is pickled by the very code that is to read it: it is read only where the key of its entry, which names that
code, is the current one. Nothing is called in reading it but the classes of this software and what arrays and tables
are made of, so that a folder of unknown origin cannot run anything.
"""

from __future__ import annotations

import io
import json
import pickle
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pyarrow

from core.serialization import plain
from pipeline.results.entry import FlightEntry, GroupEntry
from pipeline.results.fleet import GroupResult, Publish
from pipeline.results.flight import FlightResult
from pipeline.storage.store import ENTRY, RESULT, Store

#: Packages whose classes a result is made of.
_OWN = ("core", "logparse", "estimation", "sysid", "pipeline")

#: What else a result is made of: arrays, tables, times and paths.
_FOREIGN = {
    "builtins": {"slice", "complex", "set", "frozenset", "range"},
    "collections": {"OrderedDict"},
    "datetime": {"datetime", "timezone", "timedelta"},
    "numpy": {"dtype", "ndarray"},
    "numpy._core.multiarray": {"_reconstruct", "scalar"},
    "numpy._core.numeric": {"_frombuffer"},
    "pandas": {"DataFrame", "Series", "Index", "RangeIndex", "MultiIndex", "StringDtype"},
    "pandas._libs.internals": {"_unpickle_block"},
    "pandas.arrays": {"ArrowStringArray"},
    "pandas.core.arrays.string_": {"StringDtype", "StringArray"},
    "pandas.core.arrays.string_arrow": {"ArrowStringArray"},
    "pandas.core.frame": {"DataFrame"},
    "pandas.core.series": {"Series"},
    "pandas.core.indexes.base": {"_new_Index", "Index"},
    "pandas.core.indexes.multi": {"MultiIndex"},
    "pandas.core.indexes.range": {"RangeIndex"},
    "pandas.core.internals.managers": {"BlockManager", "SingleBlockManager"},
    "pathlib": {"PosixPath", "WindowsPath", "PurePosixPath"},
    "pyarrow.lib": {"_restore_array", "type_for_alias", "py_buffer"},
}


def product_of(
    result: FlightResult | GroupResult, entry: FlightEntry | GroupEntry, publish: Publish | None, scratch: Path
) -> Path:
    """Return a folder of pages, result and entry, ready to be committed to the store."""
    product = scratch / "product"
    product.mkdir()
    if publish is not None:
        publish(result, product)
        write_result(result, product)
    write_entry(entry, product)
    return product


def write_entry(entry: FlightEntry | GroupEntry, folder: Path) -> None:
    """Write what a run keeps of a flight or a craft at hand into the folder of its products."""
    (folder / ENTRY).write_text(json.dumps(plain(entry)), encoding="utf-8")


def write_result(result: FlightResult | GroupResult, folder: Path) -> None:
    """Write a result into the folder of its products; of a flight without its tables, which the datasets have."""
    kept = replace(result, tables=None) if isinstance(result, FlightResult) else result
    with pyarrow.CompressedOutputStream(str(folder / RESULT), "zstd") as stream:
        pickle.dump(kept, stream, protocol=5)


def read_result(store: Store, place: str) -> FlightResult | GroupResult | None:
    """Read the result of a folder of products; None where there is none, or none that can be read."""
    try:
        content = store.read(f"{place}/{RESULT}")
        with pyarrow.CompressedInputStream(pyarrow.BufferReader(content), "zstd") as stream:
            found = _Reader(io.BytesIO(stream.read())).load()
    except (OSError, EOFError, AttributeError, ImportError, TypeError, ValueError, IndexError, pickle.UnpicklingError):
        return None
    return found if isinstance(found, FlightResult | GroupResult) else None


class _Reader(pickle.Unpickler):
    """Reads nothing but results."""

    def find_class(self, module: str, name: str) -> object:
        """Find a class; whatever results do not consist of is refused."""
        if name in _FOREIGN.get(module, ()):
            return super().find_class(module, name)
        if module.partition(".")[0] in _OWN and "." not in name:
            found = getattr(import_module(module), name)
            if isinstance(found, type):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is no part of a result")
