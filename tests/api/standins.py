"""What the service runs in place of the pipeline where a test is about the service: quick, or bad in a known way."""

import json
import logging
import os
import signal
import time
from pathlib import Path

from api.work.worker import Task, TaskProgress
from logparse import LogError
from logparse.containers import open_buffer


def analyze(task: Task, progress: TaskProgress) -> None:
    """Behave as the first log's first word says."""
    (log, name), folder = task.logs[0], task.folder
    word = log.read_bytes()[:64].split(maxsplit=1)[0].decode("utf-8", "replace")
    progress("parsing", 0.0)
    if log.read_bytes().startswith(b"\x1f\x8b"):
        open_buffer(log, bool)
    match word:
        case "refused":
            raise LogError("no RCOU messages: set LOG_BITMASK to include motor outputs")
        case "markup":
            raise LogError(f"<script>alert(1)</script> in {name}")
        case "bug":
            raise KeyError("surprise")
        case "mumble":
            try:
                _ = 1 / 0
            except ZeroDivisionError:
                logging.getLogger("rotorid.pipeline").exception("stage gave up")
        case "hang":
            while True:
                time.sleep(0.1)
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "greedy":
            hoard = [bytearray(16 << 20) for _ in range(1 << 16)]
            del hoard
        case "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        case "slow":
            for step in range(20):
                progress("transfer functions", step / 20)
                time.sleep(0.1)
        case "until":
            progress("transfer functions", 0.4, "<b>motor 4 stopped</b>")
            signal_file = Path(log.read_text().split("|")[1])
            while not signal_file.exists():
                time.sleep(0.05)
    progress("report", 0.9)
    report = {"name": name, "rmse": [{"axis": "x", "rmse": 0.25}], "bytes": log.stat().st_size, "nothing": float("nan")}
    if len(task.logs) > 1:
        report["groups"] = [{"training": [name], "held_out": [flight for _, flight in task.logs[1:]]}]
    links = ""
    for _, flight in task.logs if len(task.logs) > 1 else ():
        (folder / "flights" / flight).mkdir(parents=True, exist_ok=True)
        (folder / "flights" / flight / "report.html").write_text(
            f"<!doctype html><title>report</title><h1>{flight}</h1>"
        )
        links += f"<a href='flights/{flight}/report.html'>{flight}</a>"
    (folder / "report.html").write_text(
        f"<!doctype html><title>report</title>{links}<script>document.title='drawn'</script>"
    )
    (folder / "report.json").write_text(json.dumps(report))
    (folder / "models.json").write_text(json.dumps({"models": []}))
    (folder / "tables").mkdir()
    (folder / "tables" / "imu.parquet").write_bytes(b"PAR1")
    (folder / "rmse.csv").write_text("flight,x,y,z\n1,0.25,0.2,0.3\n")
