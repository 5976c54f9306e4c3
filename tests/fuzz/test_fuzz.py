"""Damaged logs end in a LogError or are read: never in another exception, and never in a warning of a library."""

import numpy as np
import pytest

from logparse import read_log
from tests.fuzz.__main__ import main
from tests.fuzz.mutations import mutate
from tests.fuzz.reading import read_whole
from tests.fuzz.seeds import seeds
from tests.fuzz.spans import count, wound

#: Mutations of each format, always the same; `python -m tests.fuzz 100000` looks for new ones.
COUNT = 20

_HEAD = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
_GPS = "FMT, 3, 50, GPS, QBIHB, TimeUS,Status,GMS,GWk,NSats\n"


@pytest.mark.parametrize("ending", ["bin", "log", "tlog", "ulg"])
@pytest.mark.filterwarnings("error")
def test_mutations_end_in_an_error_for_people_or_are_read(ending, tmp_path):
    path = tmp_path / f"mutated.{ending}"
    for seed in range(COUNT):
        rng = np.random.default_rng((seed, len(ending)))
        path.write_bytes(mutate(seeds()[ending], rng, text=ending == "log"))
        read_whole(path)


@pytest.mark.parametrize("ending", ["bin", "log", "tlog", "ulg"])
def test_a_wound_costs_the_messages_that_lay_in_it_and_no_others(ending, tmp_path):
    path = tmp_path / f"wounded.{ending}"
    whole = seeds()[ending]
    path.write_bytes(whole)
    before = count(read_log(path))
    for seed in range(COUNT // 2):
        damaged, hit = wound(whole, ending, np.random.default_rng((seed, len(ending))))
        path.write_bytes(damaged)
        assert 0 <= before - count(read_log(path)) <= hit


@pytest.mark.parametrize("seed", [806086, 725899])
def test_a_clock_at_the_end_of_its_type_and_a_pressure_below_zero_are_read(seed):
    """Two of 70,000 mutations: a difference that overflowed and a root of a negative number warned."""
    assert main(seed, 1, sorted(seeds())) == 0


@pytest.mark.parametrize(
    "lines",
    [
        "FMT, 3, 50, MODE, QMf, TimeUS,Mode,ModeNum\nMODE, 1000000, inf, 424\nMODE, 2000000, 424, inf\n",
        _GPS + "GPS, 1000000, 3, inf, 2200, inf\nGPS, 2000000, 3, 5, nan, 4\n",
        _GPS + "GPS, 1000000, 3, 100, 60000, 9\nGPS, 2000000, abc, 5, x, 4\n",
        "FMT, 3, 50, PARM, Qff, TimeUS,Name,Value\nPARM, 1000000, 17, 3\nPARM, 2000000, 18, nan\n",
        "FMT, 3, 50, VIBE, QfffI, TimeUS,VibeX,VibeY,VibeZ,Clip0\nVIBE, 1, 2, x, 4, abc\nVIBE, 2000000, 2, 3, 4, 7\n",
        "FMT, 3, 50, EV, QB, TimeUS,Id\nEV, 99999999999999999999, 10\nEV, 99999999999999999999, 11\nEV, 1, inf\n",
        "FMT, ²6, 50, ATT, Qf, TimeUS,Roll\nFMT, 4, " + "5" * 5000 + ", MAG, Qf, TimeUS,MagX\nATT, 1, 2\nATT, 2, 3\n",
        "FMT, 3, 50, UNIT, QbZ, TimeUS,Id,Label\nUNIT, 1, --5, m\nUNIT, 2, ², m\nUNIT, 3, , s\n",
        "FMT, 3, 50, SYSTEM_TIME, QQ, TimeUS,time_unix_usec\nSYSTEM_TIME, 1, 9e30\nSYSTEM_TIME, 2000000, inf\n",
    ],
)
def test_values_that_no_sensor_gives_are_left_out(lines, tmp_path):
    """The places that an audit of 20,501 mutated inputs found: numbers out of range, infinite, NaN or text."""
    path = tmp_path / "odd.log"
    path.write_text(_HEAD + lines)
    read_whole(path)


def test_events_beyond_the_resolution_of_their_clock_stay_in_order(tmp_path):
    """At 1e13 s a microsecond is nothing: two events of one time still get two times."""
    path = tmp_path / "late.log"
    rows = "".join(f"EV, 18000000000000000000, {k}\n" for k in (10, 11, 15))
    path.write_text(_HEAD + "FMT, 3, 50, EV, QB, TimeUS,Id\n" + rows)
    events = read_log(path).tables.events
    assert len(events) == 3
    assert events.index.is_monotonic_increasing
    assert events.index.is_unique
