"""What the service runs in place of the pipeline where a test is about the service: quick, or bad in a known way."""

import json
import os
import signal
import time

from api.worker import Progress, Task
from logparse import LogError


def analyze(task: Task, progress: Progress) -> None:
    """Behave as the first log's first word says."""
    (log, name), folder = task.logs[0], task.folder
    word = log.read_bytes()[:64].split(maxsplit=1)[0].decode()
    progress("parsing", 0.0)
    match word:
        case "refused":
            raise LogError("no RCOU messages: set LOG_BITMASK to include motor outputs")
        case "bug":
            raise KeyError("surprise")
        case "hang":
            while True:
                time.sleep(0.1)
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "greedy":
            hoard = [bytearray(16 << 20) for _ in range(1 << 16)]
            del hoard
        case "slow":
            for step in range(20):
                progress("transfer functions", step / 20)
                time.sleep(0.1)
    progress("report", 0.9)
    report = {"name": name, "rmse": [{"axis": "x", "rmse": 0.25}], "bytes": log.stat().st_size, "nothing": float("nan")}
    (folder / "report.html").write_text("<!doctype html><title>report</title><script>document.title='drawn'</script>")
    (folder / "report.json").write_text(json.dumps(report))
    (folder / "models.json").write_text(json.dumps({"models": []}))
    (folder / "rmse.csv").write_text("flight,x,y,z\n1,0.25,0.2,0.3\n")
