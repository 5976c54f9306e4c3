"""Calls on a Dask cluster of real programs, whose workers die, lack software, or see other folders."""

import os
import re
import signal
import sys
from contextlib import closing
from importlib.util import find_spec

import fsspec
import pytest

from pipeline import AnalysisConfig, analyze_fleet
from pipeline.execution import cluster
from pipeline.execution.cluster import Cluster, SchedulerError
from pipeline.execution.executors import WorkerDiedError, as_done
from pipeline.fleet import crafts, job
from pipeline.software import _fingerprint, installed
from tests.pipeline import calls, flown
from tests.pipeline.dask_programs import Programs
from tests.s3_server import s3_server

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="needs rotorid[cluster]")


@pytest.fixture(scope="module")
def s3():
    with s3_server() as address:
        yield address


@pytest.fixture(scope="module")
def programs(s3, tmp_path_factory):
    """Run a scheduler and two workers, which reach the storage."""
    with closing(Programs(tmp_path_factory.mktemp("dask") / "folder")) as started:
        started.start_scheduler()
        for _ in range(2):
            started.start_worker()
        yield started


@pytest.fixture
def pair(programs):
    with Cluster(programs.address) as executor:
        executor.client.wait_for_workers(2)
        yield executor


@pytest.mark.slow
def test_a_killed_worker_costs_nothing_and_a_poisonous_call_only_itself(pair, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    pair.check()
    lost = pair.submit(calls.stay_at_first, (tmp_path, 2))
    with (tmp_path / "pipe").open() as reports:
        os.kill(int(reports.readline()), signal.SIGKILL)
    assert lost.result() == "done"
    diary = tmp_path / "diary"
    tasks = [(diary, name) for name in ("a", "b", "poison", "c", "d", "e")]
    outcomes = {name: future.exception() for (_, name), future in as_done(pair, calls.die_or_note, tasks)}
    death = outcomes.pop("poison")
    assert isinstance(death, WorkerDiedError)
    assert re.match(r"4 workers of the cluster died working on it, the last at tcp://127", str(death))
    assert outcomes == dict.fromkeys("abcde")


@pytest.mark.slow
def test_a_folder_on_s3_goes_by_url_to_the_workers_and_its_results_to_s3(pair, monkeypatch):
    monkeypatch.setattr(job, "run", flown.run)
    monkeypatch.setattr(crafts, "identify_craft", flown.identify_craft)
    objects, _ = fsspec.url_to_fs("s3://fleet")
    objects.mkdir("fleet")
    for name in ("octa 1", "octa 2", "quad 3"):
        objects.pipe_file(f"fleet/logs/{name.replace(' ', '')}.bin", name.encode())
    pair.check(["s3://fleet/logs"], "s3://fleet/out")
    for reused in (0, 3):
        fleet = analyze_fleet(["s3://fleet/logs"], AnalysisConfig(), pair, store="s3://fleet/out")
        assert [flight.name for flight in fleet.flights] == ["octa1", "octa2", "quad3"]
        assert not fleet.failures
        assert len(fleet.groups) == 1
        assert fleet.reused == reused
    objects.invalidate_cache()
    assert objects.exists("fleet/out/flights/octa1/entry.json")
    assert pair.submit(calls.fetched_logs).result() == [], "they are cleared away"


NO_ROTORID = """
import sys
class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "pipeline":
            raise ModuleNotFoundError("No module named 'pipeline'", name="pipeline")
sys.meta_path.insert(0, Nothing())
"""


@pytest.mark.whole
def test_a_scheduler_without_workers_then_without_rotorid_there_and_then_gone(tmp_path):
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "sitecustomize.py").write_text(NO_ROTORID)
    os.mkfifo(tmp_path / "pipe")
    with closing(Programs(tmp_path / "dask")) as programs:
        scheduler = programs.start_scheduler()
        with Cluster(programs.address) as executor:
            executor.patience = 0.1
            with pytest.raises(SchedulerError, match=r"has no workers: start some with `dask worker tcp://"):
                executor.check()
            programs.start_worker("--no-nanny", path=(tmp_path / "bare",))
            executor.client.wait_for_workers(1)
            with pytest.raises(SchedulerError, match="has no module pipeline: install rotorid"):
                executor.check()
            # Such workers may also come after the check.
            assert isinstance(executor.submit(calls.square, 2).exception(), ModuleNotFoundError)
        with Cluster(programs.address) as executor:
            waiting = [executor.submit(calls.stay, tmp_path / "pipe") for _ in range(2)]
            with (tmp_path / "pipe").open() as reports:
                reports.readline()
            executor.client._timeout = 0.1  # it will not come back
            scheduler.kill()
            assert SchedulerError in [type(future.exception()) for future in waiting]
            with pytest.raises(SchedulerError, match="the same command goes on from there"):
                executor.submit(calls.square, 2)


@pytest.mark.slow
def test_logs_that_workers_do_not_see_are_named(pair, tmp_path, monkeypatch):
    """A path stands here for another one there: relative to this program's folder."""
    monkeypatch.setattr(cluster.Path, "absolute", lambda path: path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "logs").mkdir()
    with pytest.raises(SchedulerError, match="does not see logs: logs must be on a disk that all workers share"):
        pair.check(["logs"])


def test_a_folder_of_results_that_is_another_or_cannot_be_written_is_said(tmp_path, monkeypatch):
    def refused(**_):
        raise PermissionError(13, "Permission denied")

    mark = tmp_path / "mark"
    assert cluster.look((), str(mark)).startswith(f"does not see what is in {tmp_path}: results must be on a disk")
    mark.touch()
    assert cluster.look((), str(mark)) == ""
    monkeypatch.setattr(cluster, "TemporaryFile", refused)
    assert cluster.look((), str(mark)) == f"cannot write into {tmp_path}: Permission denied"


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1:1", "https://127.0.0.1:1"])
def test_an_address_where_no_scheduler_is(address):
    with pytest.raises(SchedulerError, match=r"no Dask scheduler answers at|is no address of a scheduler"):
        Cluster(address, patience=0.2)


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SchedulerError, match=re.escape("pip install 'rotorid[cluster]'")):
        Cluster("tcp://127.0.0.1:1")


def test_other_versions_of_python_and_dask_are_named():
    def node(python="3.11.7.final.0", dask="2026.8.0", distributed="2026.8.0"):
        return {"packages": {"python": python, "dask": dask, "distributed": distributed}}

    versions = {
        "client": node(),
        "scheduler": node(dask="2024.1.0", distributed="2024.1.0"),
        "workers": {"tcp://a:1": node(python="3.11.2.final.0"), "tcp://b:1": node(python="3.12.1.final.0")},
    }
    assert cluster.differing_dask(versions) == {
        "scheduler": "has dask 2024.1.0 instead of 2026.8.0, distributed 2024.1.0 instead of 2026.8.0: "
        "install what is installed here",
        "tcp://b:1": "has Python 3.12 instead of 3.11: install what is installed here",
    }


def test_the_same_version_with_other_sources_is_refused():
    here = installed()
    assert cluster.call_guarded(here, calls.square, (3,), {}) == 9
    with pytest.raises(SchedulerError, match="other sources"):
        cluster.call_guarded(here | {"sources": "bb"}, calls.square, (3,), {})
    with pytest.raises(SchedulerError, match=f"has rotorid {re.escape(here['rotorid'])} instead of 2"):
        cluster.call_guarded(here | {"sources": "bb", "rotorid": "2"}, calls.square, (3,), {})


def test_sources_are_the_same_before_and_after_loops_are_compiled(tmp_path, monkeypatch):
    """Else a folder is analysed anew, and workers refused, for what was compiled meanwhile."""
    monkeypatch.syspath_prepend(tmp_path)
    compiled = tmp_path / "sources_of_old" / "__pycache__"
    compiled.mkdir(parents=True)
    (compiled.parent / "__init__.py").write_text("")
    before = _fingerprint(["sources_of_old"])
    (compiled / "loop.nbi").write_bytes(b"compiled")
    assert _fingerprint(["sources_of_old"]) == before
    (compiled.parent / "page.html").write_text("a template")
    assert _fingerprint(["sources_of_old"]) != before
