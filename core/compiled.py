"""Compiled functions, kept on the disk so that the next process starts with their machine code.

As numba's own ``njit(cache=True)``, but for two things.

What is kept is used at once. Numba first gets ready to compile, which takes longer than everything else that an
analysis does before it reads a log; here it does so only when something must be compiled. Of the modules that were
compiled along with a function, as numpy's allocation, none is imported for it.

What is compiled makes millions of objects that stay, in which the garbage collector would search a tenth of the time.

Processes that start together do not get in each other's way. Numba numbers the files of a function's versions: two
processes that compile two versions at the same time may both write number 1, and an index that names a new version
before its file is written may lead to the file of an older source. Here files are named after what is in them.

As with numba, files lie beside the source where that can be written, else in the user's cache folder, and in
``NUMBA_CACHE_DIR`` where that is set. Where none of these can be written, every process compiles for itself.
"""

# mypy: allow-untyped-calls

import gc
import hashlib
import io
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime.nrt import rtsys

from core.kernel_types import examples

F = TypeVar("F", bound=Callable[..., Any])


def njit(*, cache: bool = False, **options: Any) -> Callable[[F], F]:
    """Compile a function when it is first called with arguments of new types, as ``numba.njit`` does."""

    def compiled(function: F) -> F:
        dispatcher = cast(Any, numba.njit(**options))(function)
        # With NUMBA_DISABLE_JIT it is the function itself; of a function without a file nothing can be kept.
        if cache and dispatcher is not function:
            # Numba refuses the function where no folder can be written, as in a container that may only read.
            with suppress(RuntimeError):
                dispatcher._cache = _Cache(function)
            dispatcher._compiler.compile = _without_collecting(dispatcher._compiler.compile)
        return cast(F, dispatcher)

    return compiled


def _without_collecting(compile_function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile with the garbage collector off, where it is not off already."""

    def compiled(*args: Any) -> Any:
        collects = gc.isenabled()
        gc.disable()
        try:
            return compile_function(*args)
        finally:
            if collects:
                gc.enable()

    return compiled


def can_be_kept(kernel: Callable[..., Any]) -> bool:
    """Report whether there is a folder for the machine code of a function of `njit`."""
    return isinstance(getattr(kernel, "_cache", None), _Cache)


def is_kept(kernel: Callable[..., Any]) -> bool:
    """Report whether the machine code of a function of `njit` is on the disk, for arguments as it is annotated with."""
    dispatcher = cast(Any, kernel)
    return can_be_kept(kernel) and dispatcher._cache.holds(argument_types(dispatcher), dispatcher.targetctx)


def compile_ahead(kernel: Callable[..., Any]) -> None:
    """Compile a function of `njit` for arguments as it is annotated with, and keep its machine code."""
    dispatcher = cast(Any, kernel)
    dispatcher.compile(argument_types(dispatcher))


def argument_types(dispatcher: Any) -> tuple[Any, ...]:
    """Return the types, as numba knows them, that a compiled function is annotated with."""
    return tuple(numba.typeof(example) for example in examples(dispatcher.py_func))


def inner(*, allocates: bool = False, **options: Any) -> Callable[[F], F]:
    """Compile a function that only compiled functions call.

    Without the wrappers for other callers, which can take as long to compile as the function; what calls it keeps it.

    One that makes no array does not count who holds its arrays, which its callers hold anyway: counting took four
    fifths of the time of a function of ten lines. And it becomes part of each caller, so that one source has one
    machine code: a process that compiles would else call other copies than those that find them compiled, with other
    roundings.
    """
    if not allocates:
        options = {"_nrt": False, "forceinline": True, **options}
    return cast(Callable[[F], F], cast(Any, numba.njit)(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options))


class _Files(IndexDataCacheFile):
    """Files of one function: an index, and one file for each version."""

    def save(self, key: Any, data: Any) -> None:
        """Write the version's file, and then its place in the index."""
        stamp = _digest(self._source_stamp)
        name = self._data_name(f"{stamp}-{_digest(key)}")
        self._save_data(name, data)
        overloads = self._load_index()
        if not overloads:
            self._discard_older(stamp)
        overloads[key] = name
        self._save_index(overloads)

    def _load_index(self) -> dict[Any, str]:
        """Read the index; empty where it is damaged, as by a disk that was full."""
        try:
            return cast(dict[Any, str], super()._load_index())
        except Exception:  # what unpickling raises cannot be foreseen
            return {}

    def _load_data(self, name: str) -> Any:
        """Read a version's file; OSError where it is damaged, so that it is compiled anew."""
        try:
            return _Unpickler(io.BytesIO(Path(self._data_path(name)).read_bytes())).load()
        except Exception as error:
            raise OSError(f"{name} is damaged") from error

    def _discard_older(self, stamp: str) -> None:
        """Remove versions compiled from another source. A process that reads one at this moment compiles anew."""
        every = self._data_name("*")
        first = every.partition("*")[0]
        for path in Path(self._cache_path).glob(every):
            if not path.name.startswith(f"{first}{stamp}-"):
                path.unlink(missing_ok=True)

    def _data_name(self, number: Any) -> str:
        return f"{self._index_name.removesuffix('.nbi')}.{number}.nbc"


class _Unpickler(pickle.Unpickler):
    """Reads machine code without importing the modules that it came from."""

    def find_class(self, module: str, name: str) -> Any:
        """Return what a file names, with our own way to make environments."""
        if (module, name) == ("numba.core.environment", "_rebuild_env"):
            return _environment
        return super().find_class(module, name)


def _environment(module: str, constants: list[Any], name: str) -> Any:
    """Make the environment of a compiled function: as numba's own, whose globals are for interpreted code alone."""
    environment = lookup_environment(name)
    if environment is None:
        environment = Environment(vars(sys.modules[module]) if module in sys.modules else {"__name__": module})
        environment.consts[:] = constants
        environment.env_name = name
        Environment._memo[name] = environment
    return environment


class _Cache(FunctionCache):
    """Machine code of one function on the disk."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = _Files(locator.get_cache_path(), self._impl.filename_base, locator.get_source_stamp())

    def holds(self, types: tuple[Any, ...], target_context: Any) -> bool:
        """Report whether there is code for arguments of these types."""
        return self._index_key(types, target_context.codegen()) in self._cache_file._load_index()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load what is kept for these types; None when it is to be compiled."""
        # All that machine code needs of numba. What compiling needs, numba loads when it comes to compile.
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def _digest(what: Any) -> str:
    return hashlib.sha256(repr(what).encode()).hexdigest()[:16]
