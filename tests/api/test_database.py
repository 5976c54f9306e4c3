"""On both databases: the tables are what the records say, and many who work at once never get in each other's way."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from unittest import mock

import httpx
import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import create_engine, select, update

from api.logs.catalog import Catalog, Quota
from api.problems import Problem, ProblemError
from api.store.database import Database
from api.store.records import AnalysisRecord, LogRecord, Record
from api.store.resources import State
from api.store.scratch import open_upload
from api.work.outcome import Reached
from api.work.queue import Claim, Queue
from pipeline.storage.store import open_store
from tests.api import postgresql
from tests.api.conftest import served
from tests.api.programs import PATIENCE

PROBLEM = Problem(title="No", status=422, detail="No.")


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp(request.param)
    if request.param == "sqlite":
        yield f"sqlite:///{folder / 'rotorid.db'}"
        return
    with postgresql.running() as server:
        yield server.url


@pytest.fixture
def database(url: str) -> Iterator[Database]:
    """Yield a database without rows."""
    opened = Database(url)
    opened.migrate()
    with opened.write() as session:
        for table in reversed(Record.metadata.sorted_tables):
            session.execute(table.delete())
    yield opened
    opened.close()


@pytest.fixture
def catalog(database: Database, tmp_path: Path) -> Catalog:
    return Catalog(database, open_store(str(tmp_path / "objects")))


@pytest.fixture
def keep(catalog: Catalog, tmp_path: Path) -> Callable[..., str]:
    """Return a function that keeps a log and gives its id."""
    folder = tmp_path / "incoming"
    folder.mkdir()

    def keep_log(content: bytes, owner: str = "ann", catalog: Catalog = catalog) -> str:
        with open_upload(folder) as upload:
            upload.write(content)
            return catalog.keep_logs([(upload, "a.bin")], owner)[0].log.id

    return keep_log


def test_migrations_make_the_tables_of_the_records_for_several_servers_at_once(url: str) -> None:
    databases = [Database(url) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(Database.migrate, databases))
    for opened in databases:
        opened.close()
    engine = create_engine(url)
    with engine.connect() as connection:
        differences = compare_metadata(MigrationContext.configure(connection), Record.metadata)
    engine.dispose()
    assert differences == []


def test_several_servers_may_open_a_new_file_at_once(tmp_path: Path) -> None:
    def ask(server: Database) -> int | None:
        with server.read() as session:
            return session.scalar(select(1))

    for number in range(50):
        servers = [Database(f"sqlite:///{tmp_path / str(number)}.db") for _ in range(4)]
        with ThreadPoolExecutor(4) as pool:
            assert list(pool.map(ask, servers)) == [1, 1, 1, 1]
        for server in servers:
            server.close()


def test_writers_of_a_slow_sqlite_file_take_turns(tmp_path: Path) -> None:
    """Whoever had just given the lock up took it again, until the others gave up."""
    opened = [Database(f"sqlite:///{tmp_path / 'rotorid.db'}") for _ in range(2)]
    opened[0].migrate()
    turns: list[int] = []
    waiting = threading.Event()

    def write(writer: int) -> None:
        with opened[writer].write() as session:
            waiting.set()
            session.execute(select(LogRecord))  # begins the transaction
            turns.append(writer)

    with ThreadPoolExecutor(1) as pool:
        with opened[0].write() as session:
            session.execute(select(LogRecord))
            other = pool.submit(write, 1)
            assert waiting.wait(PATIENCE)
            threading.Event().wait(0.4)  # by now SQLite looks at its lock ten times a second only
        write(0)
        other.result()
    for opened_catalog in opened:
        opened_catalog.close()
    assert turns == [1, 0]


def test_a_line_of_writers_waits_as_long_as_it_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a slow disk fifty uploads at once took longer than one may wait, and ten were refused."""
    monkeypatch.setattr("api.store.database._PATIENCE", 0.5)
    opened = Database(f"sqlite:///{tmp_path / 'rotorid.db'}")
    opened.migrate()

    def write(_: int) -> None:
        with opened.write() as session:
            session.execute(select(LogRecord))
            threading.Event().wait(0.1)

    with ThreadPoolExecutor(20) as pool:
        list(pool.map(write, range(20)))
    opened.close()


def test_no_analysis_is_claimed_twice(database: Database, catalog: Catalog, keep: Callable[..., str], url: str) -> None:
    ordered = [catalog.order([keep(b"log %d" % number)], {}, "ann").id for number in range(40)]
    servers = [Database(url) for _ in range(4)]

    def claim_all(server: Database) -> list[str]:
        queue, claimed = Queue(server, lease=60.0, deaths=3), []
        while (claim := queue.claim()) is not None:
            claimed.append(claim.analysis)
        return claimed

    with ThreadPoolExecutor(8) as pool:
        claimed = [analysis for server in pool.map(claim_all, servers * 2) for analysis in server]
    for server in servers:
        server.close()
    assert sorted(claimed) == sorted(ordered)
    with database.read() as session:
        assert set(session.scalars(select(AnalysisRecord.attempts))) == {1}


def test_a_lost_lease_changes_nothing(database: Database, catalog: Catalog, keep: Callable[..., str]) -> None:
    analysis = catalog.order([keep(b"log")], {}, "ann").id
    queue = Queue(database, lease=60.0, deaths=3)
    slow = queue.claim()
    assert slow is not None
    _let_expire(database, slow)
    quick = queue.claim()
    assert quick is not None
    assert (quick.analysis, quick.lease != slow.lease) == (analysis, True)
    for change in (
        lambda: queue.prolong(slow, Reached("late", 0.9)),
        lambda: queue.finish(slow, {"late.txt": 1}),
        lambda: queue.fail(slow, PROBLEM),
        lambda: queue.give_back(slow),
        lambda: queue.retry(slow),
    ):
        assert not change()
    assert queue.finish(quick, {"report.html": 3})
    # The answer may be lost on its way: asked for again, it was done, and by this claim only.
    assert queue.finish(quick, {"report.html": 3})
    assert not queue.finish(slow, {"late.txt": 1})
    kept = catalog.find_analysis(analysis, "ann")
    assert kept is not None
    assert (kept.state, kept.files, kept.attempts) == (State.DONE, {"report.html": 3}, 2)


def test_an_analysis_that_takes_its_process_or_whole_servers_down_is_given_up(
    database: Database, catalog: Catalog, keep: Callable[..., str]
) -> None:
    analysis = catalog.order([keep(b"log")], {}, "ann").id
    queue = Queue(database, lease=60.0, deaths=3)
    for again in (True, True, False):
        claim = queue.claim()
        assert claim is not None
        assert queue.retry(claim) is again
    _let_expire(database, claim)
    attempts = 1  # those that were tried again count as not begun
    while (claim := queue.claim()) is not None:
        attempts += 1
        _let_expire(database, claim)
    kept = catalog.find_analysis(analysis, "ann")
    assert kept is not None
    assert kept.problem is not None
    assert (kept.state, attempts) == (State.FAILED, 20)
    assert "begun 20 times" in kept.problem.detail


def test_the_same_log_many_times_at_once_is_one_log(
    database: Database, keep: Callable[..., str], tmp_path: Path
) -> None:
    with ThreadPoolExecutor(8) as pool:
        ids = set(pool.map(keep, [b"one and the same"] * 24))
    assert len(ids) == 1
    assert {path.name for path in (tmp_path / "objects" / "logs").iterdir()} == ids


def test_a_limit_holds_however_many_come_at_once(
    database: Database, catalog: Catalog, keep: Callable[..., str], tmp_path: Path
) -> None:
    limited = Catalog(database, open_store(str(tmp_path / "objects")), Quota(logs=5))

    def try_to_keep(number: int) -> bool:
        try:
            keep(b"log %d" % number, catalog=limited)
        except ProblemError:
            return False
        return True

    with ThreadPoolExecutor(4) as pool:
        kept = sum(pool.map(try_to_keep, range(12)))
    # On PostgreSQL two that look at the same time may both find room; on SQLite one waits for the other.
    assert kept == catalog.count_logs("ann") == len(list((tmp_path / "objects" / "logs").iterdir()))
    assert 5 <= kept <= (5 if database.url.startswith("sqlite") else 8)


def test_ordering_and_deleting_at_once_leaves_no_analysis_without_its_log(
    database: Database, catalog: Catalog, keep: Callable[..., str]
) -> None:
    logs = [keep(b"log %d" % number) for number in range(10)]

    def order(log: str) -> bool:
        try:
            catalog.order([log], {}, "ann")
        except KeyError:
            return False
        return True

    def delete(log: str) -> None:
        catalog.delete_log(log, "ann")

    with ThreadPoolExecutor(8) as pool:
        jobs = [pool.submit(work, log) for log in logs for work in (order, order, delete, order)]
        for job in jobs:
            job.result()
    with database.read() as session:
        assert session.scalars(select(LogRecord.id)).all() == []
        assert session.scalars(select(AnalysisRecord.id)).all() == []


def test_the_whole_way_of_a_log(
    url: str, database: Database, tmp_path: Path, upload: Callable[..., httpx.Response]
) -> None:
    database.close()  # which has left no rows
    with served(data=tmp_path, database=url, workers=1) as client:
        done = upload(client, b"good log", "Höhe 🚁.bin")
        assert (done.status_code, done.json()["report"]["name"]) == (201, "Höhe 🚁.bin")
        assert upload(client, b"refused").status_code == 422
        assert client.get("/readyz").json() == {"status": "ok"}
        assert "rotorid_logs 2.0" in client.get("/metrics").text
        for strange in ("\0", "%", "_", "\ud7ff", "'", "\\"):
            answer = client.get("/api/v1/logs", params={"name": strange, "after": strange})
            assert (answer.status_code, answer.json()["items"]) == (200, [])
            assert client.get("/api/v1/analyses", params={"log": strange, "after": strange}).json()["items"] == []
            assert client.get(f"/api/v1/analyses/{strange.encode().hex()}").status_code == 404
        assert [log["name"] for log in client.get("/api/v1/logs", params={"name": "🚁"}).json()["items"]] == [
            "Höhe 🚁.bin"
        ]
        assert client.delete(done.json()["links"]["log"]).status_code == 204
        assert client.get(done.headers["Location"]).status_code == 404


def test_a_clock_that_steps_back_blocks_nothing(database: Database, catalog: Catalog, keep: Callable[..., str]) -> None:
    """A lease given an hour ahead, whose worker is dead, once blocked its analysis for that hour."""
    analysis = catalog.order([keep(b"log")], {}, "ann").id
    queue = Queue(database, lease=60.0, deaths=3)
    assert queue.claim() is not None
    for seconds, free in ((90.0, False), (3600.0, True)):  # a clock that is half a minute ahead is not robbed
        until = datetime.now(UTC) + timedelta(seconds=seconds)
        with database.write() as session:
            session.execute(update(AnalysisRecord).values(lease_until=until))
        claimed = queue.claim()
        assert (claimed is not None and claimed.analysis == analysis) is free


class _AnHourBehind(datetime):
    @classmethod
    def now(cls, tz: tzinfo | None = None) -> "_AnHourBehind":
        return super().now(tz) - timedelta(hours=1)


def test_workers_whose_clocks_differ_take_nothing_from_each_other(
    database: Database, catalog: Catalog, keep: Callable[..., str], url: str
) -> None:
    """One an hour behind and others took six analyses from each other up to 18 times."""
    if url.startswith("sqlite"):
        pytest.skip("its workers share a computer and its clock")
    catalog.order([keep(b"log")], {}, "ann")
    queue = Queue(database, lease=60.0, deaths=3)
    claim = queue.claim()
    assert claim is not None
    with mock.patch("api.store.database.datetime", _AnHourBehind), mock.patch("api.work.queue.datetime", _AnHourBehind):
        assert queue.prolong(claim)
        assert queue.claim() is None
    assert queue.claim() is None


def _let_expire(database: Database, claim: Claim) -> None:
    """Make a worker silent for too long."""
    past = datetime.now(UTC) - timedelta(days=1)
    with database.write() as session:
        session.execute(update(AnalysisRecord).where(AnalysisRecord.id == claim.analysis).values(lease_until=past))


def test_owners_take_turns(database: Database, catalog: Catalog, keep: Callable[..., str]) -> None:
    """Whoever orders 20 at once keeps nobody waiting for more than one of them."""
    many = [catalog.order([keep(b"ann %d" % number)], {}, "ann").id for number in range(20)]
    few = [catalog.order([keep(b"bob %d" % number, "bob")], {}, "bob").id for number in range(2)]
    queue, turns = Queue(database, lease=60.0, deaths=3), []
    for _ in range(6):
        claim = queue.claim()
        assert claim is not None
        turns.append(claim.analysis)
        assert queue.finish(claim, {})
    assert turns == [many[0], few[0], many[1], few[1], many[2], many[3]]
    assert queue.claim() is not None  # one of ann's runs now: a newcomer comes first
    late = catalog.order([keep(b"eve", "eve")], {}, "eve").id
    claim = queue.claim()
    assert claim is not None
    assert claim.analysis == late
    again = catalog.order([keep(b"eve again", "eve")], {}, "eve").id
    assert queue.finish(claim, {})
    claim = queue.claim()  # hers was the latest to begin, but ann's is still at work
    assert claim is not None
    assert claim.analysis == again
