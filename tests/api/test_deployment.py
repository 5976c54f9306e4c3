"""What an operator installs: the systemd unit leaves the service little of the machine."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[2] / "deploy" / "rotorid.service"


def test_the_unit_is_hardened() -> None:
    """2.5 of 10 is the goal; what is left is network, an address family or two, and numba's own machine code."""
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd-analyze is not installed")
    said = subprocess.run(
        [program, "security", "--offline=true", "--no-pager", str(UNIT)], capture_output=True, text=True, check=False
    )
    found = re.search(r"exposure level for rotorid.service: ([0-9.]+)", said.stdout)
    if found is None:
        pytest.skip(f"this systemd-analyze judges no files: {said.stderr.strip()}")
    assert float(found[1]) < 2.5


def test_the_unit_lets_analyses_limit_themselves_and_numba_compile() -> None:
    lines = UNIT.read_text().splitlines()
    assert not any(line.startswith("SystemCallFilter=~") and "@resources" in line for line in lines)
    assert not any(line.startswith("MemoryDenyWriteExecute") for line in lines)
    assert "UMask=0077" in lines


def test_the_image_has_every_package_of_ours() -> None:
    """It once lacked the command line."""
    root = UNIT.parents[1]
    ours = {path.parent.name for path in root.glob("*/__init__.py")} - {"tests", "benchmarks"}
    copied = set(re.findall(r"^COPY (\w+) \1$", (root / "deploy" / "Dockerfile").read_text(), re.MULTILINE))
    assert "rotorid" in ours
    assert ours <= copied


def test_what_is_installed_for_the_service_is_pinned_as_elsewhere_and_hashed() -> None:
    """With hashes in constraints.txt itself pip would ask for one of this very folder, which it cannot have."""
    root = UNIT.parents[1]
    pinned = set(re.findall(r"^(\S+==\S+)", (root / "constraints.txt").read_text(), re.MULTILINE))
    entries = re.split(r"^(?=\S)", (UNIT.parent / "requirements.txt").read_text(), flags=re.MULTILINE)[1:]
    assert len(entries) > 50
    assert [entry for entry in entries if "--hash=sha256:" not in entry] == []
    assert {entry.split()[0] for entry in entries} <= pinned
    dockerfile = (root / "deploy" / "Dockerfile").read_text()
    assert "--require-hashes -r requirements.txt" in dockerfile
    assert "--no-deps ." in dockerfile
