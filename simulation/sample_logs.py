"""Write `sample_logs/`: logs of simulated flights with the truth beside them, the same files on every run."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from simulation.flight_log import write_bin, write_tlog
from simulation.fly import Flight, fly
from simulation.instruments import InstrumentedFlight
from simulation.sample_flights import FLIGHTS, SampleFlight
from simulation.truth import describe_mission

#: The damaged log: which flight it was, and its name.
DAMAGED_FLIGHT, DAMAGED = "octa04_bergen_gusty", "octa13_damaged"


def fly_sample(sample: SampleFlight) -> Flight:
    """Fly a sample's mission, recorded as finely as it is logged."""
    return fly(sample.setup, rate=max(100.0, sample.logging.imu, sample.logging.rate))


def write_flight(sample: SampleFlight, folder: Path, flight: Flight | None = None) -> list[Path]:
    """Write the log of a flight (`.bin`), its truth (`.json`) and, where it has one, its telemetry log (`.tlog`)."""
    folder.mkdir(parents=True, exist_ok=True)
    flight = flight or fly_sample(sample)
    log = InstrumentedFlight(flight, sample.start_utc, sample.boot)
    paths = [folder / f"{sample.name}.bin", folder / f"{sample.name}.json"]
    write_bin(paths[0], log, sample.logging)
    truth = describe_mission(flight, log, sample.name, sample.summary, sample.logging.imu)
    paths[1].write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    if sample.telemetry:
        paths.append(folder / f"{sample.name}.tlog")
        write_tlog(paths[2], log)
    return paths


def write_sample_logs(folder: str | Path, progress: Callable[[str, float], None] | None = None) -> list[Path]:
    """Fly all samples and write their logs and truth; the same files on every run.

    Parameters
    ----------
    folder : path-like
        Made if missing; files of the same names are overwritten.
    progress : callable, optional
        Called with what is being written and the fraction done.

    Returns
    -------
    list of Path
        The files written.
    """
    folder = Path(folder)
    paths: list[Path] = []
    for done, sample in enumerate(FLIGHTS.values()):
        if progress is not None:
            progress(sample.name, done / len(FLIGHTS))
        paths += write_flight(sample, folder)
    paths += write_damaged(folder)
    if progress is not None:
        progress("sample logs", 1.0)
    return paths


def write_damaged(folder: Path) -> list[Path]:
    """Write a log that a card has spoilt, from the log of `DAMAGED_FLIGHT` in the folder, and its truth.

    A block of the card was never written and holds 0xFF, another holds what was there before, some bytes are gone,
    and the battery was pulled in flight, in the middle of a row.
    """
    whole = (folder / f"{DAMAGED_FLIGHT}.bin").read_bytes()
    random = np.random.RandomState(113)
    data = bytearray(whole)
    erased, stale, lost = (round(share * len(data)) for share in (0.35, 0.55, 0.62))
    data[erased : erased + 4096] = b"\xff" * 4096
    data[stale : stale + 2048] = random.randint(0, 256, 2048, dtype=np.uint8).tobytes()
    del data[lost : lost + 37]
    del data[round(0.8 * len(data)) + 11 :]
    paths = [folder / f"{DAMAGED}.bin", folder / f"{DAMAGED}.json"]
    paths[0].write_bytes(data)
    truth = json.loads((folder / f"{DAMAGED_FLIGHT}.json").read_text(encoding="utf-8"))
    truth["name"] = DAMAGED
    truth["damage"] = {
        "flight": DAMAGED_FLIGHT,
        "bytes_of_the_whole_log": len(whole),
        "bytes_left": len(data),
        "erased_block": [erased, erased + 4096],
        "stale_block": [stale, stale + 2048],
        "bytes_lost": [lost, lost + 37],
        "end": "cut in flight, inside a row",
    }
    paths[1].write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return paths
