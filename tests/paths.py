"""Where the project lies, and the logs that are in it and beside it."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_logs"
#: Not everybody has these: a test that needs one is skipped where it is not there.
SHARED = ROOT.parent / "shared" / "logs"
REAL, SITL = SHARED / "real", SHARED / "sitl"
