"""Files whose counts and lengths were changed end in a sentence, soon and in little memory."""

import gzip
import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from logparse import LogError, read_log
from logparse.expressions import evaluate
from logparse.foreign.columns import read_column_map
from logparse.foreign.files import TableError
from logparse.signals import SignalError
from tests.fuzz import structures
from tests.fuzz.px4_seed import px4_log
from tests.paths import SAMPLES

#: Mutations of each kind here; `python -m tests.fuzz 10000` does more.
COUNT = 6


@pytest.mark.parametrize("kind", structures.KINDS)
@pytest.mark.filterwarnings("error")
def test_changed_counts_and_lengths_end_in_an_error_for_people(kind: str, tmp_path: Path) -> None:
    structures.read(kind, structures.seed(kind), tmp_path)
    for k in range(COUNT):
        structures.read(kind, structures.mutate(kind, np.random.default_rng((k, len(kind)))), tmp_path)


@pytest.mark.parametrize(
    ("kind", "number"), [("csv", 10040), ("csv", 13900), ("yaml", 10449), ("mat", 146), ("mat", 1054), ("mat", 2432)]
)
@pytest.mark.filterwarnings("error")
def test_mutations_that_once_broke(kind: str, number: int, tmp_path: Path) -> None:
    """Whole numbers of 400 digits, rows longer than their header (24 s), kinds of elements that SciPy crashed at."""
    structures.read(kind, structures.mutate(kind, np.random.default_rng((number, len(kind)))), tmp_path)


def px4_with(path: Path, fields: bytes, *formats: bytes) -> Path:
    """Write a log of PX4 whose attitude has these fields, behind other formats."""
    whole, old = px4_log(5), b"vehicle_attitude:uint64_t timestamp;float[4] q;"
    at = whole.index(old) - 3
    written = (*formats, b"vehicle_attitude:" + fields)
    new = b"".join(struct.pack("<HB", len(chunk), ord("F")) + chunk for chunk in written)
    path.write_bytes(whole[:at] + new + whole[at + 3 + len(old) :])
    return path


def test_a_text_called_as_the_time_is_does_not_become_it(tmp_path: Path) -> None:
    path = px4_with(tmp_path / "flight.ulg", b"uint64_t timestamp;char[16] timestamp;")
    assert len(read_log(path).messages["vehicle_attitude"]) == 5


@pytest.mark.parametrize(
    "fields",
    [
        # Times that are no whole number of us.
        b"double timestamp;float[4] q;",
        b"int64_t timestamp;float[4] q;",
        # A few bytes of a format of 60 kB took 60 s and 3.5 GB before a row was read.
        b"uint64_t timestamp;float[60000] q;",  # a count that was 4
        b"uint64_t timestamp;vehicle_attitude[9] again;",  # a format within itself
        b"uint64_t timestamp;sensor_combined[60000] a;",  # thousands of another
        b"uint64_t timestamp;nothing[60000] a;nothing[60000] b;",  # without a field, but as long to go through
    ],
)
def test_a_topic_of_px4_that_no_log_can_have_is_left_out(fields: bytes, tmp_path: Path) -> None:
    log = read_log(px4_with(tmp_path / "flight.ulg", fields, b"nothing:"))
    assert "vehicle_attitude" not in log.messages
    assert len(log.messages["sensor_combined"]) == 5


@pytest.mark.parametrize("packed", ["gz", "zip"])
def test_an_archive_unpacks_to_no_more_than_its_size_allows(packed: str, tmp_path: Path) -> None:
    """Rows again and again took 1.2 GB of memory for an archive of 667 kB: each byte unpacked becomes several."""
    whole = px4_log(60)
    path, content = tmp_path / f"flight.ulg.{packed}", whole + whole[-4000:] * 5500
    if packed == "gz":
        path.write_bytes(gzip.compress(content, 1))
    else:
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("flight.ulg", content)
        path.write_bytes(file.getvalue())
    with pytest.raises(LogError, match="unpacks to more than"):
        read_log(path)


def test_a_parameter_whose_name_is_a_number_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "odd.log"
    path.write_text(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 3, 50, PARM, QNf, TimeUS,Name,Value\n"
        "PARM, 1000000, MOT_SPIN_MIN, 0.15\nPARM, 2000000, , inf\nPARM, 3000000, nan, 1e30\nPARM, 4000000, 17, inf\n"
    )
    assert read_log(path).parameters["MOT_SPIN_MIN"] == pytest.approx(0.15)


@pytest.mark.parametrize(
    "value", ["!!int abc", "!!timestamp 1-1-1", "[" * 3000, "&a [*a, *a]", "!!float x", "2024-13-45"]
)
def test_yaml_that_its_own_reader_stumbles_over_is_refused(value: str, tmp_path: Path) -> None:
    path = tmp_path / "columns.yaml"
    path.write_text(f"time: {value}\n")
    with pytest.raises(TableError):
        read_column_map(path)


def test_a_description_that_is_none_or_is_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "columns.yaml").write_text("- a\n- b\n")
    with pytest.raises(TableError, match="mapping"):
        read_column_map(tmp_path / "columns.yaml")
    with pytest.raises(TableError, match="no such file"):
        read_column_map(tmp_path / "none.yaml")


def test_a_table_whose_time_is_also_a_position_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(structures.seed("csv"))
    columns = tmp_path / "columns.yaml"
    columns.write_bytes(structures.seed("yaml").replace(b"[x, y, z]", b"[t, y, z]"))
    with pytest.raises(TableError, match="column t is the time"):
        structures.read_motion(path, columns)


@pytest.mark.parametrize(
    "text", ["ATT.Roll ** 1e999", "ATT.Roll ** (0/0)", f"ATT.Roll ** 0x{'f' * 60}", f"ATT.Roll * 0x{'f' * 290}"]
)
def test_numbers_without_end_are_no_part_of_an_expression(text: str, sample: Path) -> None:
    with pytest.raises(SignalError):
        evaluate(read_log(sample), text)


@pytest.fixture
def sample() -> Path:
    """Return a log with ATT."""
    return SAMPLES / "octa02_alain_breeze.bin"


def test_an_infinite_instance_is_none(tmp_path: Path) -> None:
    head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 3, 50, IMU, QBf, TimeUS,I,GyrX\n"
    (path := tmp_path / "odd.log").write_text(head + "IMU, 1000000, 0, 1\nIMU, 2000000, inf, 2\nIMU, 3000000, 0, 3\n")
    assert evaluate(read_log(path), "IMU[0].GyrX").y[0] == 1.0
