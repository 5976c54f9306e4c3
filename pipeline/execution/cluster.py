"""The workers of a Dask scheduler, on other computers, as an executor.

Only small calls and what they return pass through the scheduler: logs are read from and results written to storage that
all computers reach. Before the first call it is made sure that they do, and that the same software computes everywhere.
"""

import gc
import pickle
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryFile
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from core.lazy import lazy
from logparse import RotoridError
from pipeline.execution.executors import WorkerDiedError
from pipeline.names import is_url
from pipeline.software import installed

if TYPE_CHECKING:
    import distributed
else:
    distributed = lazy("distributed")

R = TypeVar("R")

#: What a worker says that has the version of rotorid, but not its sources.
OTHER_SOURCES = "has other sources of rotorid under the same version: install what is installed here"

#: Seconds until a scheduler must have answered, and until it must have a first worker.
PATIENCE = 30.0

#: Workers that one message names.
MOST_NAMED = 3


class SchedulerError(RotoridError):
    """A cluster cannot be worked with; the message says what to do on which computer."""


class Cluster(Executor):
    """The workers of a Dask scheduler; SchedulerError where Dask is not installed, or none answers at the address."""

    def __init__(self, address: str, patience: float = PATIENCE) -> None:
        if find_spec("distributed") is None:
            raise SchedulerError(
                "working with a scheduler needs Dask, which is not installed: pip install 'rotorid[cluster]'"
            )
        if not _has_port(address):  # Dask would look for it for a minute
            raise SchedulerError(f"{address!r} is no address of a scheduler: give host and port, as tcp://cluster:8786")
        self.address = address
        self.patience = patience
        self._software: Mapping[str, Any] | None = None
        failure = ""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore", distributed.versions.VersionMismatchWarning
                )  # `check` says it in a sentence
                self.client: Any = distributed.Client(address, timeout=patience, set_as_default=False)  # type: ignore[no-untyped-call]
        except OSError as error:
            failure = (
                f"no Dask scheduler answers at {address}: start one with `dask scheduler`, or look for a mistake in "
                f"the address and for a firewall ({str(error) or type(error).__name__})"
            )
        except Exception as error:
            failure = (
                f"{address!r} is no address of a scheduler, such as tcp://cluster:8786, or another version of Dask "
                f"runs there ({type(error).__name__}: {error})"
            )
        if failure:
            # What is left of the client waits for itself when it is collected while another one starts.
            gc.collect()
            raise SchedulerError(failure)

    @property
    def in_flight(self) -> int:
        """How many calls keep all workers busy.

        None waits at a worker beside the one that it is at: Dask would suspect both when the worker dies.
        """
        try:
            threads: dict[str, int] = self.client.nthreads()
        except OSError:  # `submit` says that the connection is lost
            return 1
        return max(1, sum(threads.values()))

    def submit(self, function: Callable[..., R], /, *args: Any, **named: Any) -> Future[R]:
        """Make a function called on the cluster.

        The future raises `WorkerDiedError` where the call took down every worker that it was tried on, and
        `SchedulerError` where the connection to the scheduler is lost, as this does where it is lost already.
        """
        if self.client.status != "running":
            self.shutdown()
            raise self._lost()
        call = (function, args, named)
        packed = _packed(*call) if self._software is None else _packed(work, (self._software, *call), {})
        future: Future[R] = Future()
        theirs = self.client.submit(_trampoline(), packed, pure=False)
        theirs.add_done_callback(partial(self._hand_over, future))
        return future

    def _hand_over(self, future: Future[Any], theirs: Any) -> None:
        """Return the outcome of a call on the cluster to whoever waits for it; in Dask's thread."""
        try:
            error = self._lost() if theirs.status in ("cancelled", "lost") else theirs.exception()
            result = None if error else theirs.result()
        except Exception as failed:  # on its way from the worker
            result, error = None, failed
        if isinstance(error, distributed.scheduler.KilledWorker):
            error = WorkerDiedError(
                f"{error.allowed_failures + 1} workers of the cluster died working on it, the last at "
                f"{error.last_worker.address}; when memory runs out, Dask ends its workers (--memory-limit)"
            )
        if not future.set_running_or_notify_cancel():
            return
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)

    def _lost(self) -> SchedulerError:
        return SchedulerError(
            f"the connection to the scheduler at {self.address} is lost; what was stored is kept, and the same command "
            "goes on from there"
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster to itself: what it has begun it finishes, what it has not begun it forgets."""
        with suppress(TimeoutError):  # nobody answers where the scheduler is gone
            self.client.close()

    def check(self, places: Iterable[str | Path] = (), store: str | Path | None = None) -> None:
        """Make sure that there are workers, with this software, and that they see what this computer sees.

        SchedulerError says what they lack. Workers that come later and have other software refuse calls from now on.
        """
        try:
            self.client.wait_for_workers(1, timeout=self.patience)
        except TimeoutError:
            raise SchedulerError(
                f"the scheduler at {self.address} has no workers: start some with `dask worker {self.address}`"
            ) from None
        _refuse(differing_dask(self.client.get_versions()))
        self._software = installed()
        local = tuple(str(Path(place).absolute()) for place in places if not is_url(place))
        with _marked(None if store is None or is_url(store) else Path(store)) as mark:
            view = _packed(call_guarded, (self._software, look, (local, mark), {}), {})
            answers: dict[str, Any] = self.client.run(_trampoline(), view, on_error="return")
        _refuse({worker: _sentence(answer) for worker, answer in answers.items() if answer})


def _refuse(problems: Mapping[str, str]) -> None:
    """Raise SchedulerError where there are problems, by where they are."""
    if problems:
        some = "\n".join(f"  {place}: {problem}" for place, problem in list(problems.items())[:MOST_NAMED])
        more = f"\n  and {len(problems) - MOST_NAMED} more" if len(problems) > MOST_NAMED else ""
        raise SchedulerError(f"the cluster cannot do this work:\n{some}{more}")


def differing_dask(versions: Mapping[str, Any]) -> dict[str, str]:
    """Return where Python or Dask differ from here, by `Client.get_versions`: code would not arrive whole."""

    def relevant(node: Mapping[str, Any]) -> dict[str, str]:
        packages = node["packages"]
        python = ".".join(packages["python"].split(".")[:2])
        return {"Python": python, "dask": packages["dask"], "distributed": packages["distributed"]}

    nodes = {"scheduler": versions["scheduler"], **versions["workers"]}
    here = relevant(versions["client"])
    problems = {place: _difference(relevant(node), here) for place, node in nodes.items()}
    return {place: problem for place, problem in problems.items() if problem}


def _difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Report which versions differ; empty when none do."""
    differing = [
        f"{name} {there.get(name) or 'missing'} instead of {here[name]}"
        for name in here
        if there.get(name) != here[name]
    ]
    return f"has {', '.join(differing)}: install what is installed here" if differing else ""


def _sentence(answer: str | Exception) -> str:
    """Report what is wrong with a worker, from what it answered."""
    if isinstance(answer, ModuleNotFoundError):
        return f"has no module {answer.name}: install rotorid {installed()['rotorid']} there"
    if isinstance(answer, Exception):
        return str(answer) if isinstance(answer, RotoridError) else f"{type(answer).__name__}: {answer}"
    return answer


@contextmanager
def _marked(store: Path | None) -> Iterator[str | None]:
    """Leave a file in the folder of the store for the time of a ``with``, for workers to find; gives its path."""
    if store is None:
        yield None
        return
    store.mkdir(parents=True, exist_ok=True)
    with NamedTemporaryFile(prefix=".rotorid-", dir=store.absolute()) as mark:
        yield mark.name


def look(places: Sequence[str], mark: str | None) -> str:
    """Report, on a worker, what it does not see of the other computer's folders; empty when it sees all."""
    everywhere = "must be on a disk that all workers share under the same path, or given by a URL such as s3://"
    for place in places:
        if not Path(place).exists():
            return f"does not see {place}: logs {everywhere}"
    if mark is not None:
        store = Path(mark).parent
        if not Path(mark).exists():
            return f"does not see what is in {store}: results {everywhere}"
        try:
            with TemporaryFile(dir=store):
                pass
        except OSError as error:
            return f"cannot write into {store}: {error.strerror}"
    return ""


def work(expected: Mapping[str, Any], function: Callable[..., R], args: Sequence[Any], named: Mapping[str, Any]) -> R:
    """Do a submitted call on a worker, see `call_guarded`."""
    # Dask clears this folder up, also after a worker that was killed.
    tempfile.tempdir = distributed.get_worker().local_directory
    return call_guarded(expected, function, args, named)


def call_guarded(
    expected: Mapping[str, Any], function: Callable[..., R], args: Sequence[Any], named: Mapping[str, Any]
) -> R:
    """Call a function on a worker; SchedulerError where its software is not as expected."""
    own = installed()
    if own != expected:
        libraries = _difference(own["libraries"], expected["libraries"])
        raise SchedulerError(libraries or _difference(own, {"rotorid": expected["rotorid"]}) or OTHER_SOURCES)
    return function(*args, **named)


def _has_port(address: str) -> bool:
    try:
        return urlsplit(address if "://" in address else f"tcp://{address}").port is not None
    except ValueError:
        return False


def _trampoline() -> Callable[[bytes], Any]:
    """Make the function that workers call.

    It travels as code, not by name, and what it is given as bytes: a worker or scheduler that has no rotorid then says
    so, where a name that it cannot import would break its connection.
    """

    def call(packed: bytes) -> Any:
        import pickle  # noqa: PLC0415 -- travels with the code

        function, args, named = pickle.loads(packed)
        return function(*args, **named)

    return call


def _packed(function: Callable[..., Any], args: Sequence[Any], named: Mapping[str, Any]) -> bytes:
    return pickle.dumps((function, args, named), pickle.HIGHEST_PROTOCOL)
