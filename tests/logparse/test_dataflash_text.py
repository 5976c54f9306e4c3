"""DataFlash text logs: real ones against pymavlink, and what is odd in them."""

import numpy as np
import pytest
from pymavlink import DFReader

from logparse import read_log
from logparse.dataflash.text import DataflashTextSource
from tests.paths import REAL

TEXT = ["DigitalSarcasm-Quadcopter__nan.log", "Javiercerna-pixhawk-flight-time__2016-11-09_16-33-24.log"]

HEAD = """FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format
FMT, 129, 23, PARM, Nf, Name,Value
FMT, 130, 14, GPS, BIHI, Status,TimeMS,Week,T
FMT, 1, 11, ATT, cccC, RollIn,Roll,PitchIn,Yaw
FMT, 3, 6, MODE, Mh, Mode,ThrCrs
FMT, 4, 67, MSG, Z, Message
FMT, 10, 3, STRT, ,
"""


@pytest.mark.skipif(not REAL.exists(), reason="the shared logs are not beside the project")
@pytest.mark.parametrize("name", TEXT)
def test_real_logs_as_pymavlink_reads_them(name: str) -> None:
    """Every row of every type, each field of the first rows and of the last."""
    source = DataflashTextSource((REAL / name).read_bytes())
    (boot,) = source.boots
    reader = DFReader.DFReader_text(str(REAL / name))
    theirs: dict[str, list[DFReader.DFMessage]] = {}
    while (message := reader.recv_msg()) is not None:
        theirs.setdefault(message.get_type(), []).append(message)
    reader.data_map.close()
    reader.filehandle.close()
    counts = source.counts(boot)
    # pymavlink drops the one FMT line that has no columns.
    assert counts.pop("FMT") - len(theirs.pop("FMT")) in (0, 1)
    assert counts == {kind: len(rows) for kind, rows in theirs.items()}
    for kind, rows in theirs.items():
        frame = source.decode(kind, boot)
        for k in (*range(min(20, len(rows))), len(rows) - 1):
            for field in rows[k]._fieldnames:
                if (kind, field) == ("MODE", "Mode"):
                    continue  # pymavlink fails on a mode given by name.
                value = getattr(rows[k], field)
                ours = frame[field].iloc[k]
                assert ours == value or (np.isnan(ours) and np.isnan(value)), (kind, field)


def test_only_gps_carries_time() -> None:
    """3.0-era tables: rows without a clock lie between the GPS rows around them, by the bytes of the binary log."""
    body = "PARM, A, 1\n"
    for k in range(10):
        body += f"GPS, 3, {90_000_000 + 200 * k}, 1765, {5000 + 200 * k}\n"
        body += "ATT, 0.00, 1.25, 0.00, 359.99\n" * 3
    source = DataflashTextSource((HEAD + body).encode())
    (boot,) = source.boots
    assert (boot.t_start, boot.t_end) == (5.0, 6.8)
    att = source.decode("ATT", boot)
    # A GPS row has 14 bytes, one of ATT 11.
    within = 0.2 * np.array([14, 25, 36]) / 47
    np.testing.assert_allclose(att.index[:6], [*(5.0 + within), *(5.2 + within)])
    assert att["Roll"].tolist() == [1.25] * 30
    assert att["Yaw"].iloc[0] == np.float32(359.99)
    assert source.decode("GPS", boot).index[1] == 5.2
    assert source.decode("PARM", boot).index.tolist() == [5.0]


def test_prelude_windows_lines_and_values_without_blanks() -> None:
    """Lines before the first FMT line, CRLF, commas without blanks, text with commas, modes by name and number."""
    text = "ArduCopter V3.0.1\nFree RAM: 1331\n APM 2\n\n" + HEAD
    text += "MODE,STABILIZE,500\nMODE, 5, 400\nMSG, one, two,  three\n"
    text += "PARM,RATE_RLL_P,0.15\nPARM, B, NaN\nPARM, C, 1e3\n"
    text += "GPS,3,1000,1765,5000\nGPS, 3, 1200, 1765, 5200\n"
    source = DataflashTextSource(text.replace("\n", "\r\n").encode())
    (boot,) = source.boots
    assert source.decode("MODE", boot)["Mode"].tolist() == ["STABILIZE", "5"]
    assert source.decode("MSG", boot)["Message"].tolist() == ["one, two,  three"]
    parameters = source.decode("PARM", boot)
    assert parameters["Name"].tolist() == ["RATE_RLL_P", "B", "C"]
    np.testing.assert_array_equal(parameters["Value"], [0.15, np.nan, 1000.0])
    assert source.findings == ()


def test_values_separated_by_blanks_alone() -> None:
    text = HEAD + "GPS 3 1000 1765 5000\nATT 0.00 1.25 0.00 90.00\nGPS 3 1200 1765 5200\n"
    source = DataflashTextSource(text.encode())
    (boot,) = source.boots
    assert source.decode("ATT", boot)["Roll"].tolist() == [1.25]


def test_units_and_multipliers_of_modern_logs() -> None:
    text = """FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 2, 44, FMTU, QBNN, TimeUS,FmtType,UnitIds,MultIds
FMT, 3, 76, UNIT, QbZ, TimeUS,Id,Label
FMT, 4, 20, MULT, Qbd, TimeUS,Id,Mult
FMT, 5, 23, MAG, QBhcL, TimeUS,I,MagX,Alt,Lat
UNIT, 1000, 71, Gauss
UNIT, 1000, m, m
MULT, 1000, 67, 0.001
MULT, 1000, 71, 1E-07
MULT, 1000, 66, 0.01
FMTU, 1000, 5, s#GmD, F-CBG
MAG, 2000, 1, 321, 12.34, -35.3632621
"""
    source = DataflashTextSource(text.encode())
    frame = source.decode("MAG", source.boots[0])
    assert frame.iloc[0].tolist() == pytest.approx([2000, 1, 0.321, 12.34, -35.3632621], rel=1e-7)
    assert frame.attrs["units"] == {"TimeUS": "us", "MagX": "Gauss", "Alt": "m"}
    assert frame.attrs["multipliers"] == {"MagX": 0.001, "Alt": 0.01, "Lat": 1e-7}
    assert frame.attrs["instance"] == "I"


def test_64_bit_integers_are_exact() -> None:
    text = "FMT, 1, 19, X, QQ, TimeUS,Big\nX, 1000, 18446744073709551615\nX, 2000, 9007199254740993\n"
    source = DataflashTextSource(text.encode())
    assert source.decode("X", source.boots[0])["Big"].tolist() == [18446744073709551615, 9007199254740993]


def test_a_damaged_clock_costs_its_line_and_no_other_times() -> None:
    lines = [f"X, {t}\n" for t in range(1_000_000, 2_000_000, 100_000)]
    lines[4] = "X, 14000.0\n"
    source = DataflashTextSource(("FMT, 1, 11, X, Q, TimeUS\n" + "".join(lines)).encode())
    times = source.decode("X", source.boots[0]).index
    assert times.tolist() == [1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.7, 1.8, 1.9]


def test_damaged_lines_cost_themselves_only() -> None:
    text = HEAD + "GPS, 3, 1000, 1765, 5000\nATT, 1, x, 3\nATT, 1, 2, 3, 4\nQQ, 1\nGPS, 3, 12\nATT, 5, 6, 7, 8"
    source = DataflashTextSource(text.encode() + b"\n\xff\xfe\xff\n")
    (boot,) = source.boots
    assert source.decode("ATT", boot)["Roll"].tolist() == [2, 6]
    assert {finding.id: dict(finding.evidence) for finding in source.findings} == {
        "file-damaged": {"lines": 2},
        "message-layout": {"messages": 2},
    }


def test_firmware_of_2013_has_only_the_receivers_clock(tmp_path):
    """3.0 logs GPS ms of week as its one clock, zero before the fix, and names the firmware before the first line."""
    head = HEAD.replace("Status,TimeMS,Week,T", "Status,Time,NSats,HDop").replace("GPS, BIHI", "GPS, BIBc")
    rows = [
        f"GPS, {0 if k < 3 else 3}, {0 if k < 3 else 500000000 + 200 * k}, 9, 1.1\nATT, 0.0, {k}.0, 0.0, 90\n"
        for k in range(20)
    ]
    path = tmp_path / "old.log"
    path.write_text("ArduCopter V3.0.1 (5c6503e2)\nFree RAM: 1331\n" + head + "".join(rows), encoding="utf-8")
    log = read_log(path)
    assert (log.vehicle.firmware, log.vehicle.version, log.vehicle.git_hash) == ("ArduCopter", "3.0.1", "5c6503e2")
    assert log.duration == pytest.approx(0.2 * 16)
    assert np.diff(log.messages["ATT"].index[4:-1]) == pytest.approx(0.2)
    assert "clock-doubtful" in {finding.id for finding in log.findings}
