"""What holds for all tests: kernels are compiled before they start, no example has a deadline, Ctrl-C is heard."""

import fcntl
import gc
import lzma
import multiprocessing
import os
import pickle
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from multiprocessing import forkserver
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from logparse import containers
from rotorid.cli import main as cli
from tests.paths import ROOT, SAMPLES, SHARED, SITL

if TYPE_CHECKING:
    from estimation import Trajectory
    from logparse import FlightLog
    from pipeline import FleetResult

# A slow computer, or the first example of a kernel, is no failure.
settings.register_profile("rotorid", deadline=None)
settings.load_profile("rotorid")

# A shell lets what it runs in the background ignore Ctrl-C, and so the programs that tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

#: Packages with kernels.
_COMPILED = ("core", "logparse", "estimation", "sysid", "simulation")

#: Programs that between them call nearly every kernel; they run side by side and leave the machine code in the cache.
_KERNELS = (
    """
from pathlib import Path
from pipeline import AnalysisConfig, analyze
analyze(Path("sample_logs/octa01_zurich_calm.bin"), AnalysisConfig(poles=2, zeros=1, time_limit=3600.0))
""",
    """
from estimation import estimate
from logparse import read_log
from simulation.cases import CASES
estimate(read_log("sample_logs/octa02_alain_breeze.tlog").tables)
for case in ("motion-vertical", "octa01_zurich_calm"):
    CASES[case].run({})
""",
)


#: What calls in other processes need: the pipeline, the service's side of it, and what stands for both in tests.
FORKED = ["pipeline.fleet.job", "api.work.worker", "tests.api.standins", "tests.api.flights", "tests.pipeline.flown"]

#: Fixtures, and parameters of tests, that stand for a program beside the tests: a browser, a database server.
_PROGRAMS = {"browser", "postgresql", "s3"}


def _modules(table: str) -> set[Path]:
    """Return the modules of a table: a folder of tests, a colon, and names in it without `test_`."""
    folder, files = "", set[Path]()
    for word in table.split():
        if word.endswith(":"):
            folder = word.removesuffix(":")
        else:
            files.add(ROOT / "tests" / folder / f"test_{word}.py")
    assert all(path.is_file() for path in files), [path for path in files if not path.is_file()]
    return files


#: Modules whose tests take more than two seconds beside the slow ones, nine tenths of the time of all: `make check`
#: leaves them to `make test`.
_LENGTHY = _modules("""
    api: access analyses attacks confinement crafts database ends hooks hostile openapi operation pages problems
        server
    core: compiled
    estimation: estimate filter further_sensors heights robustness
    fuzz: fuzz
    logparse: dataflash_damage dataflash_edges dataflash_fidelity export frames hostile inspection
        tables_shared_logs tlog tlog_damage tlog_fidelity
    logparse/foreign: tables
    pipeline: account account_logs bad_fields cli every_flight executors fleet identification replay review
        stages
    reports: first_screen fleet_report folder
    rotorid: commands front_door start
    simulation: cases sample_logs
    sysid: bench export gusts kim2017 motor_loss pem refinement2020 rigid_body structures trim
    sysid/autopilot: drag_and_thrust_curve notch_of_the_gyro
    sysid/frequency: bad_input flights sources
    sysid/loops: as_flown design loop ordinary procedure tuning
    sysid/six_dof: six_dof
""")

#: The longest of all, half a minute and more each: whichever came last would leave the other workers idle.
_LONGEST = _modules("""
    api: browser crafts faults
    docs: pages tutorial
    estimation: acceptance sitl
    fuzz: fuzz
    pipeline: shared_logs
    sysid: rigid_body_flights starts
""")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave lengthy modules unread where none of their tests would run: reading all takes every worker seconds."""
    return (collection_path in _LENGTHY and "not lengthy" in config.option.markexpr) or None


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> Iterator[None]:
    """Count tests that start a browser or a database server among the slow ones; begin with the longest modules.

    Then come those with any slow test, and the rest; the order within each of these groups stays random.
    """
    for item in items:
        if item.path in _LENGTHY:
            item.add_marker("lengthy")
        if item.get_closest_marker("whole"):
            item.add_marker("slow")
        parameters = getattr(item, "callspec", None)
        used = {*getattr(item, "fixturenames", ()), *map(str, parameters.params.values() if parameters else ())}
        if used & _PROGRAMS:
            item.add_marker("slow")
    yield
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path not in _LONGEST, item.path not in slow))


def pytest_collection_finish() -> None:
    """Leave what is imported by now out of every search for garbage: a tenth of the CPU time of all tests."""
    gc.collect()
    gc.freeze()


def pytest_unconfigure() -> None:
    """Look for all garbage at the end: some bindings complain of what is left."""
    gc.unfreeze()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile kernels once, before the workers of pytest-xdist start: each would compile them for itself.

    It also keeps the minute that compilation may take on a slow computer out of the time limits of fits. What was
    compiled from these very sources is not looked at again.
    """
    if not session.config.getoption("numprocesses", None):
        return
    sources = [path for package in _COMPILED for path in (ROOT / package).rglob("*.py") if "njit" in path.read_text()]
    compiled = {str(path.relative_to(ROOT)): [path.stat().st_size, path.stat().st_mtime] for path in sources}
    cache = session.config.cache
    if cache is None or cache.get("rotorid/kernels", None) != compiled:
        programs = [[sys.executable, "-c", program] for program in _KERNELS]
        # All tests are read once as well: else each worker compiles all that they import to byte code of its own.
        reading = "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"
        programs.append([sys.executable, "-m", *reading])
        started = [subprocess.Popen(program, cwd=ROOT, stdout=subprocess.DEVNULL) for program in programs]
        ended = [program.wait() for program in started]
        if not any(ended) and cache is not None:
            cache.set("rotorid/kernels", compiled)


@pytest.fixture
def limit_unpacked() -> Iterator[Callable[[int], None]]:
    """Yield the function that bounds what archives may unpack to in this process; the test's bound ends with it."""
    yield containers.limit_unpacked
    containers.limit_unpacked(containers.MAX_UNPACKED_BYTES)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[], bytes]], Path]:
    """Return a function that gives the path of a file of this name, made by whichever worker asks for it first."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "made"
    folder.mkdir(exist_ok=True)

    def file(name: str, make: Callable[[], bytes]) -> Path:
        path = folder / name
        if not path.exists():
            part = folder / f"{name}.{os.getpid()}"
            part.write_bytes(make())
            part.replace(path)
        return path

    return file


@pytest.fixture(scope="session")
def two_analysed(made_once: Callable[[str, Callable[[], bytes]], Path]) -> "tuple[Path, FleetResult]":
    """Return the folder of an analysis of two sample logs, and what it found.

    Whichever worker asks first does the work; another waits and finds it done. Nobody writes into the folder.
    """
    import rotorid as ro

    lock = made_once("two_analysed.lock", bytes)
    logs = [SAMPLES / f"{name}.bin" for name in ("octa01_zurich_calm", "quad01_davos_esc")]
    with lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        out = lock.with_suffix("")
        return out, ro.analyze(logs, out=out, poles=1, zeros=0, time_limit=3600.0)


@pytest.fixture(scope="session")
def unpacked(made_once: Callable[[str, Callable[[], bytes]], Path]) -> Callable[[str], Path]:
    """Return a function that gives the path of a packed log of ../shared/logs, such as ``pairs/octa8_id``.

    A test that asks for one that is not here is skipped.
    """

    def unpack(name: str) -> Path:
        packed = SHARED / f"{name}.BIN.xz"
        if not packed.exists():
            pytest.skip(f"../shared/logs/{name}.BIN.xz is not here")
        return made_once(f"{Path(name).name}.BIN", lambda: lzma.decompress(packed.read_bytes()))

    return unpack


@pytest.fixture(scope="session")
def sitl(
    made_once: Callable[[str, Callable[[], bytes]], Path],
) -> "Callable[[str], tuple[FlightLog, Trajectory]]":
    """Return a function that gives a log of ../shared/logs/sitl by its name, and its trajectory, which is made once.

    A test that asks for one that is not here is skipped.
    """
    from estimation import estimate
    from logparse import read_log

    @cache
    def flown(name: str) -> "tuple[FlightLog, Trajectory]":
        path = SITL / f"{name}.BIN"
        if not path.exists():
            pytest.skip(f"../shared/logs/sitl/{name}.BIN is not here")
        log = read_log(path)
        kept = made_once(f"{name}.trajectory", lambda: pickle.dumps(estimate(log.tables)))
        return log, pickle.loads(kept.read_bytes())

    return flown


@pytest.fixture(scope="session")
def forks() -> None:
    """Start the process that workers are forked from. Whoever starts it first says what it has imported, for good.

    Without this it is the first test that forks, by chance, and each process of the others imports for seconds.
    """
    multiprocessing.get_context("forkserver").set_forkserver_preload(FORKED)
    forkserver.ensure_running()


@pytest.fixture
def rotorid_here(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., "subprocess.CompletedProcess[str]"]:
    """Return a function that runs a command in this process: one of its own spends a second or more on imports."""
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("NO_COLOR", "1")

    def run(*arguments: object) -> "subprocess.CompletedProcess[str]":
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main([*map(str, arguments)])
        shown = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return subprocess.CompletedProcess(arguments, ended.value.code, shown.out, shown.err)

    return run


@pytest.fixture(scope="module")
def browser():
    """Run Chromium; for one module only, for its event loop would be in the way of other tests'."""
    sync_playwright = pytest.importorskip("playwright.sync_api").sync_playwright
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("Chromium is not installed (Debian: apt-get install chromium)")
    with sync_playwright() as playwright:
        # Chromium's own sandbox does not work for root, as whom CI runs.
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()
