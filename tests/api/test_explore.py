"""What is asked of a log while somebody waits: junk is refused at the door, fields are listed, signals are thinned."""

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from api import Settings
from api.machine import questions
from api.machine.answers import NoSignal, SignalSpectrum
from api.problems import ProblemError
from api.work.desk import Desk
from api.work.worker import analyze_logs
from logparse import read_log
from tests.api.conftest import served
from tests.api.programs import wait_until
from tests.paths import SAMPLES

SAMPLE = SAMPLES / "quad01_davos_esc.bin"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """Run a service with the real pipeline and no worker that would begin to analyse."""
    with served(Settings(data=tmp_path_factory.mktemp("data"), workers=1), analyze_logs) as client:
        yield client


@pytest.fixture
def log(service: httpx.Client) -> str:
    """Upload a log, unanalysed; give its address. One test deletes it, so each has its own."""
    answer = service.post("/api/v1/logs", files={"file": (SAMPLE.name, SAMPLE.read_bytes())})
    assert answer.status_code == 201, answer.text
    return f"/api/v1/logs/{answer.json()['id']}"


def test_junk_is_refused_when_it_is_uploaded(service: httpx.Client) -> None:
    before = len(service.get("/api/v1/logs").json()["items"])
    for content, says in ((b"# Shopping\n" * 50, "it is a text"), (b"PK\x03\x04" + bytes(99), "zip archive")):
        answer = service.post("/api/v1/logs", files={"file": ("holiday.bin", content)})
        assert (answer.status_code, answer.json()["title"]) == (422, "The log cannot be analysed")
        assert says in answer.json()["detail"]
        assert "holiday.bin" in answer.json()["detail"]
    assert len(service.get("/api/v1/logs").json()["items"]) == before


def test_messages_and_fields_are_listed(service: httpx.Client, log: str) -> None:
    answer = service.get(f"{log}/messages").json()
    truth = read_log(SAMPLE)
    assert {message["name"]: message["rows"] for message in answer["messages"]}["IMU"] == len(truth.messages["IMU"])
    said = [(moment["kind"], moment["text"]) for moment in answer["moments"]]
    assert {("mode", "AUTO"), ("event", "ARMED"), ("message", "Mission: 1 Takeoff")} <= set(said)
    assert answer["moments"] == sorted(answer["moments"], key=lambda moment: moment["t"])
    fields = service.get(f"{log}/messages/ESC").json()["fields"]
    assert {"text": "ESC[1].RPM", "unit": "rpm"} in fields
    assert "Time" not in fields[0]["text"]
    assert service.get(f"{log}/messages/NONE").status_code == 422


def test_a_signal_is_thinned_and_no_peak_is_lost(service: httpx.Client, log: str) -> None:
    truth = read_log(SAMPLE).messages["IMU"]["AccZ"]
    (item,) = service.get(f"{log}/signals", params={"signal": "IMU.AccZ", "points": 100}).json()["signals"]
    assert len(item["t"]) <= 100
    assert item["samples"] == len(truth)
    assert min(item["y"]) == pytest.approx(truth.min(), rel=1e-6)
    assert max(item["y"]) == pytest.approx(truth.max(), rel=1e-6)
    near = truth.loc[50.0:51.0]
    window = {"signal": "IMU.AccZ", "start": 50.0, "stop": 51.0}
    (item,) = service.get(f"{log}/signals", params=window).json()["signals"]
    assert item["samples"] == len(near)
    inside = (np.array(item["t"]) >= 50.0) & (np.array(item["t"]) <= 51.0)
    np.testing.assert_allclose(np.array(item["y"])[inside], near, rtol=1e-6)


def test_a_spectrum_has_the_amplitude_of_a_sine_and_the_speed_of_the_rotors(tmp_path: Path) -> None:
    path, rate = tmp_path / "sine.log", 200.0
    t = np.arange(0.0, 20.0, 1.0 / rate)
    rows = "".join(f"IMU, {1e6 * at + 1e6:.0f}, {0.3 * np.sin(2.0 * np.pi * 40.0 * at):.7f}\n" for at in t)
    path.write_text(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 3, 50, IMU, Qf, TimeUS,GyrX\n" + rows
    )
    (spectrum,) = questions.read_spectra(path, "sine.log", ["IMU.GyrX"], None, None).signals
    assert isinstance(spectrum, SignalSpectrum)
    k = int(np.argmax(spectrum.y))
    assert spectrum.hz[k] == pytest.approx(40.0, abs=0.5)
    assert np.hypot(*spectrum.y[k : k + 2]) == pytest.approx(0.3, rel=0.25)  # of a line between two frequencies
    turned = questions.read_spectra(SAMPLE, SAMPLE.name, ["imu.gyro_x", "IMU.Nothing"], 40.0, 60.0)
    assert turned.rotors_hz == pytest.approx((98.0, 98.0), abs=6.0)  # the log's ESCs say 5,600 to 6,100 rpm
    assert isinstance(turned.signals[1], NoSignal)
    none = questions.read_spectra(path, "sine.log", ["IMU.GyrX", "IMU.GyrX * 1e300"], 12.0, 11.0)
    assert [type(answer) for answer in none.signals] == [NoSignal, NoSignal]
    (huge,) = questions.read_spectra(path, "sine.log", ["IMU.GyrX * 1e300"], None, None).signals
    assert isinstance(huge, SignalSpectrum)
    assert None in huge.y


def test_parameters_say_what_was_changed_since_the_flight_before(tmp_path: Path) -> None:
    head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 3, 50, PARM, QNf, TimeUS,Name,Value\n"
    values: list[dict[str, float]] = [
        {"ATC_RAT_RLL_P": 0.1, "STAT_FLTTIME": 10, "OLD": 1},
        {"ATC_RAT_RLL_P": 0.2, "STAT_FLTTIME": 90, "NEW": 2},
    ]
    paths = [tmp_path / "before.log", tmp_path / "after.log"]
    for path, value in zip(paths, values, strict=True):
        value["BROKEN"] = float("inf")
        path.write_text(head + "".join(f"PARM, {k}, {name}, {value[name]}\n" for k, name in enumerate(value, start=1)))
    listing = questions.list_parameters(paths[1], "after.log", (paths[0], "before.log"))
    assert listing.before == "before.log"
    rows = [(row.name, row.before, row.changed) for row in listing.parameters]
    assert rows == [("ATC_RAT_RLL_P", 0.1, True), ("NEW", None, False), ("STAT_FLTTIME", 10.0, False)]
    assert {row.before for row in questions.list_parameters(paths[1], "after.log", None).parameters} == {None}


def test_what_cannot_be_drawn_is_said_beside_what_can(service: httpx.Client, log: str) -> None:
    params = {"signal": ["ATT.Roll - ATT.DesRoll", "ATT.Roll + IMU.AccZ", "<b>.x"]}
    good, added, odd = service.get(f"{log}/signals", params=params).json()["signals"]
    assert good["unit"] == "deg"
    assert "cannot be added" in added["problem"]
    assert "cannot be read" in odd["problem"]
    assert service.get(f"{log}/signals", params={"signal": "ATT.Roll", "start": "nan"}).status_code == 422
    assert service.get("/api/v1/logs/0/signals", params={"signal": "ATT.Roll"}).status_code == 404


def never(question: str, arguments: tuple[object, ...]) -> None:
    """Answer later than anybody waits."""
    time.sleep(600.0)


def test_a_question_that_takes_too_long_is_given_up_and_the_next_is_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hasty = Desk(2_000_000_000, patience=0.2)
    with monkeypatch.context() as slow:
        slow.setattr(sys.modules[Desk.__module__], "_answer", never)
        with pytest.raises(ProblemError) as given_up:
            hasty.ask("recognise", SAMPLE, "a.bin")
        assert given_up.value.problem.status == 503
        hasty.refuse_junk(tmp_path, "a.bin")  # what nobody can look at now passes
    hasty.patience = 120.0
    assert hasty.ask("recognise", SAMPLE, "a.bin") is None
    os.kill(hasty._process.schedule(os.getpid).result(), signal.SIGKILL)  # while it has nothing to do
    wait_until(lambda: not hasty._process.active)
    assert hasty.ask("recognise", SAMPLE, "a.bin") is None
    hasty.close()


def test_logs_are_listed_searched_and_deleted_on_their_page(service: httpx.Client, log: str) -> None:
    log_id = log.rpartition("/")[2]
    assert SAMPLE.name in service.get("/logs").text
    assert SAMPLE.name in service.get("/logs", params={"q": "DAVOS"}).text
    assert "No log has such a name" in service.get("/logs", params={"q": "zurich"}).text
    explore = service.get(f"/logs/{log_id}/explore", params={"signal": '"><script>alert(1)</script>'})
    assert "<script>alert" not in explore.text
    assert service.post(f"/logs/{log_id}/delete").status_code == 303
    assert service.get(log).status_code == 404
