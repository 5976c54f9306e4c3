"""Every analysis ends once, for itself: poisonous logs, cancelling and deleting on the way, two servers, one queue."""

import gzip
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from sqlalchemy.exc import OperationalError

from api import Settings
from api.work.queue import Queue
from tests.api.conftest import Upload, served
from tests.api.programs import wait_until
from tests.api.visits import ordered, told


def test_poisonous_logs_fail_alone_after_so_many_attempts(tmp_path: Path) -> None:
    """Good logs beside them are done; the poison is tried as often as it may, and no more."""
    settings = Settings(data=tmp_path, workers=2, deaths=3, memory_limit=600_000_000, upload_limit=4_000_000)
    bomb = gzip.compress(bytes(5_000_000))
    poison = {
        b"crash": (3, "analysis-crashed", "mistake of rotorid, not yours"),
        b"killed": (3, "analysis-too-large", "more than the 600 MB"),  # the kernel's way to say so
        b"greedy": (1, "analysis-too-large", "more than the 600 MB"),
        b"refused": (1, "unusable-log", "set LOG_BITMASK to include motor outputs"),
        b"bug": (1, "analysis-crashed", "mistake of rotorid, not yours"),
        bomb: (1, "unusable-log", "unpacks to more than 0.004 GB"),
    }
    with served(settings) as client:
        orders = {content: ordered(client, content)[1] for content in (b"good 1", *poison, b"good 2")}
        wait_until(lambda: all(client.get(at).json()["ended"] for at in orders.values()), pause=0.1)
        answers = {content: client.get(at).json() for content, at in orders.items()}
    for content, answer in answers.items():
        state, (attempts, kind, says) = ("failed", poison[content]) if content in poison else ("done", (1, "", ""))
        problem = answer["problem"] or {"type": "", "detail": ""}
        assert (answer["state"], answer["attempts"]) == (state, attempts), content
        assert problem["type"].rpartition(":")[2] == kind
        assert says in problem["detail"]


@pytest.mark.slow
def test_an_endless_analysis_is_ended_and_gives_its_place_to_the_next(tmp_path: Path, upload: Upload) -> None:
    """Both hang: on a busy computer a time so short may end a good log as well."""
    with served(data=tmp_path, workers=1, time_limit=1.0) as client:
        _, first = ordered(client, b"hang")
        response = upload(client, b"hang second")
        assert response.status_code == 422
        assert response.json()["type"] == "urn:rotorid:problem:analysis-too-slow"
        assert "ended after 1 s" in response.json()["detail"]
        ended = client.get(first).json()
    assert (ended["state"], ended["attempts"]) == ("failed", 1)
    assert ended["problem"]["type"] == "urn:rotorid:problem:analysis-too-slow"


@pytest.fixture
def patient_service(tmp_path: Path) -> Iterator[httpx.Client]:
    with served(data=tmp_path, workers=1, lease=1.0) as client:
        yield client


def test_a_running_analysis_is_cancelled_and_a_waiting_one_never_begun(
    patient_service: httpx.Client, tmp_path: Path
) -> None:
    _, address = ordered(patient_service, b"hang")
    _, never = ordered(patient_service, b"good log")
    _, waiting = ordered(patient_service, b"good, but second")
    wait_until(lambda: told(patient_service, address, "state") == "running")
    assert patient_service.post(f"{never}/cancel").json()["state"] == "cancelled"
    cancelled = patient_service.post(f"{address}/cancel")
    assert (cancelled.status_code, cancelled.json()["state"]) == (200, "cancelled")
    wait_until(lambda: told(patient_service, waiting, "state") == "done")  # its process is gone and its place free
    again = patient_service.post(f"{address}/cancel").json()
    assert (again["state"], again["ended"]) == ("cancelled", cancelled.json()["ended"])
    assert patient_service.post(f"{waiting}/cancel").json()["state"] == "done"
    assert patient_service.get(never).json()["attempts"] == 0
    wait_until(lambda: not list((tmp_path / "scratch").glob("*/*")))


@pytest.mark.parametrize("what", ["log", "analysis"])
def test_what_is_deleted_while_it_is_worked_on_stays_deleted(
    patient_service: httpx.Client, tmp_path: Path, what: str
) -> None:
    log, address = ordered(patient_service, b"hang")
    _, waiting = ordered(patient_service, b"good, but second")
    wait_until(lambda: told(patient_service, address, "state") == "running")
    gone = f"/api/v1/logs/{log}" if what == "log" else address
    assert patient_service.delete(gone).status_code == 204
    assert patient_service.delete(gone).status_code == 404
    assert patient_service.get(address).status_code == 404
    wait_until(lambda: told(patient_service, waiting, "state") == "done")
    assert (tmp_path / "objects" / "logs" / log).exists() == (what == "analysis")
    assert not any(path.is_file() for path in (tmp_path / "objects" / address.rpartition("/")[0]).rglob("*"))


def test_logs_of_one_name_are_analysed_together(patient_service: httpx.Client) -> None:
    files = [("file", ("a.bin", b"good one")), ("file", ("a.bin", b"good two"))]
    logs = [log["id"] for log in patient_service.post("/api/v1/logs", files=files).json()["logs"]]
    address = patient_service.post("/api/v1/analyses", json={"logs": logs}).headers["Location"]
    wait_until(lambda: bool(patient_service.get(address).json()["ended"]))
    assert told(patient_service, address, "state") == "done"


def test_two_servers_share_one_queue_and_do_nothing_twice(tmp_path: Path) -> None:
    """They even share their data folder, and neither clears away what the other one is receiving."""
    settings = Settings(data=tmp_path, workers=2)
    with ExitStack() as stack:
        clients = [stack.enter_context(served(settings)) for _ in range(2)]
        addresses = [ordered(clients[number % 2], b"brief %d" % number)[1] for number in range(8)]
        wait_until(lambda: all(clients[0].get(at).json()["ended"] for at in addresses), pause=0.1)
        answers = [clients[number % 2].get(at).json() for number, at in enumerate(addresses)]
        assert {(answer["state"], answer["attempts"]) for answer in answers} == {("done", 1)}
        folders = list((tmp_path / "scratch").iterdir())
        assert len(folders) == 2
        # A third that comes and goes leaves both alone.
        with served(settings):
            assert len(list((tmp_path / "scratch").iterdir())) == 3
        assert sorted((tmp_path / "scratch").iterdir()) == sorted(folders)


def test_a_service_that_cannot_read_its_queue_waits_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    claim, failures = Queue.claim, iter(range(2))

    def claim_later(queue: Queue) -> object:
        if next(failures, None) is not None:
            raise OperationalError("claim", {}, Exception("gone"))
        return claim(queue)

    monkeypatch.setattr(Queue, "claim", claim_later)
    with served(data=tmp_path, workers=1) as client:
        _, address = ordered(client, b"good log")
        wait_until(lambda: told(client, address, "state") == "done")
