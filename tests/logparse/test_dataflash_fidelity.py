"""Every message of every shared DataFlash log, against pymavlink.

pymavlink's index says where it found messages and its format table how they are packed and scaled; the values behind
both are compared with our columns field by field.
"""

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from pymavlink import DFReader

from logparse.dataflash.binary import DataflashSource
from logparse.dataflash.format import FIELD_TYPES
from tests.forms import thinned
from tests.paths import SHARED

BINARY = sorted(path for path in SHARED.glob("*/*") if path.suffix.lower() == ".bin")
#: Enough for a quick look; the others are compared in the slow tests.
QUICK = [path for path in BINARY if path.stat().st_size < 3_000_000]
SLOW = [path for path in BINARY if path not in QUICK]


def index_by_pymavlink(path: Path) -> tuple[dict[int, npt.NDArray[np.int64]], dict[int, DFReader.DFFormat]]:
    """Offsets of whole messages by id, and formats by id."""
    reader = DFReader.DFReader_binary(str(path))
    size = path.stat().st_size
    formats = dict(reader.formats)
    offsets = {}
    for message_id, offset in enumerate(reader.offsets):
        if len(offset) and message_id in formats:
            # pymavlink lists a message that the end of the file cuts short, and fails when asked for it.
            offsets[message_id] = np.array([o for o in offset if o + formats[message_id].len <= size], np.int64)
    reader.close()
    return offsets, formats


def test_characters_of_formats_are_packed_and_scaled_as_pymavlink_does() -> None:
    for char, (code, scale, _) in DFReader.FORMAT_TO_STRUCT.items():
        kind = FIELD_TYPES[char]
        assert kind.size == struct.calcsize("<" + code)
        # pymavlink reads flight modes as signed.
        assert kind.is_text or char in "aM" or kind.dtype == np.dtype("<" + code)
        assert kind.divisor == (1 if scale is None else round(1 / scale))


def assert_same_values(column: pd.Series, raw: npt.NDArray[np.generic], char: str, scale: float, where: str) -> None:
    """Compare one column with what the file holds."""
    kind = FIELD_TYPES[char]
    if char == "a":
        ours = np.stack(column.to_numpy()) if len(column) else np.empty((0, 32))
        np.testing.assert_array_equal(ours, raw, err_msg=where)
    elif kind.is_text:
        if column.dtype == object:
            assert [bytes(cell) for cell in column] == [cell.ljust(kind.size, b"\0") for cell in raw.tolist()], where
        else:
            expected = [cell.split(b"\0")[0] for cell in raw.tolist()]
            assert column.tolist() == [_text(cell) for cell in expected], where
    elif kind.dtype.kind == "f":
        np.testing.assert_allclose(
            column.to_numpy(), raw.astype(np.float64) * scale, rtol=2e-7 if scale != 1 else 0, err_msg=where
        )
    else:
        unscaled = np.rint(column.to_numpy() / scale) if scale != 1 else column.to_numpy()
        np.testing.assert_array_equal(unscaled.astype(raw.dtype), raw, err_msg=where)


def _text(cell: bytes) -> str:
    try:
        return cell.decode()
    except UnicodeDecodeError:
        return cell.decode("latin-1")


@pytest.mark.parametrize("path", [*thinned(QUICK, 2), *thinned(SLOW, 4)], ids=lambda path: path.name)
def test_counts_and_values_are_those_of_pymavlink(path: Path) -> None:
    """Compare a whole log."""
    offsets, formats = index_by_pymavlink(path)
    data = np.fromfile(path, np.uint8)
    source = DataflashSource(data.tobytes())
    (boot,) = source.boots
    counts = source.counts(boot)
    assert counts == {formats[k].name: len(offset) for k, offset in offsets.items() if len(offset)}
    frames = source.decode_many(counts, boot)
    for message_id, offset in offsets.items():
        form = formats[message_id]
        if not len(offset):
            continue
        frame = frames[form.name]
        assert list(frame.columns) == form.columns
        rows = data[offset[:, None] + np.arange(form.len)]
        position = 3
        for name, char in zip(form.columns, form.format, strict=True):
            kind = FIELD_TYPES[char]
            raw = np.ascontiguousarray(rows[:, position : position + kind.size]).view(kind.dtype)
            position += kind.size
            scale = frame.attrs["multipliers"].get(name, 1.0)
            if kind.divisor != 1:
                assert scale == 1 / kind.divisor
            assert_same_values(
                frame[name], raw if char == "a" else raw[:, 0], char, scale, f"{path.name}: {form.name}.{name}"
            )


@pytest.mark.skipif(not BINARY, reason="the shared logs are not beside the project")
@pytest.mark.parametrize(
    ("name", "boot_clock"),
    [
        ("peterbarker-dataflash-logs__1.BIN", (55.4, 902.8)),
        ("erlerobot-logs__11-2-2015_112.BIN", (12.0, 650.7)),
        ("spark404-dataflashlog__log.bin", (73.6, 510.7)),
    ],
)
def test_boot_clock_of_old_logs(name: str, boot_clock: tuple[float, float]) -> None:
    """GPS rows whose TimeMS is the receiver's, long pauses, rows that step back: one boot, GPS on the boot clock."""
    source = DataflashSource((SHARED / "real" / name).read_bytes())
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == pytest.approx(boot_clock, abs=0.1)
    gps = source.decode("GPS", boot)
    assert gps.index.min() >= boot.t_start - 1
    assert gps.index.max() <= boot.t_end + 1
    parameters = source.decode("PARM", boot)
    assert parameters.index.is_monotonic_increasing
    assert parameters.index.min() >= boot.t_start
