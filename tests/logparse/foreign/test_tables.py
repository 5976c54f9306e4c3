"""Tables of other origin: what is right is read whatever its form, what is wrong is named with its column."""

from contextlib import suppress
from functools import cache

import h5py
import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from logparse import RotoridError
from logparse.foreign.clock import without_spikes
from logparse.foreign.files import TableError, read_columns
from logparse.foreign.motion import read_motion
from sysid import Experiment

RATE = 100.0
G = 9.80665
ANGLES = np.radians([45.0, -135.0, -45.0, 135.0])
SPINS = np.array([-1.0, -1.0, 1.0, 1.0])


@cache
def motion(seed=0, seconds=30.0):
    """Motion that is consistent by construction, NED and FRD: attitude from smooth angles, acceleration from thrust."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    wave = lambda top, fast: sum(  # noqa: E731
        top / 3 * np.sin(2 * np.pi * rng.uniform(0.2, fast) * t + rng.uniform(0, 6.28)) for _ in range(3)
    )
    angles = np.column_stack([wave(0.5, 1.2), wave(0.5, 1.2), wave(1.0, 0.4) + 0.7])
    rotation = Rotation.from_euler("ZYX", angles[:, ::-1])
    turn = (rotation[:-1].inv() * rotation[1:]).as_rotvec() * RATE
    rates = np.vstack([turn[:1], 0.5 * (turn[1:] + turn[:-1]), turn[-1:]])
    thrust = G + wave(3.0, 1.0)
    acceleration = rotation.apply(np.column_stack([0 * t, 0 * t, -thrust])) + np.array([0.0, 0.0, G])
    velocity = np.cumsum(acceleration, axis=0) / RATE
    velocity -= np.linspace(0, 1, len(t))[:, None] * velocity[-1]
    position = np.cumsum(velocity, axis=0) / RATE
    moment = np.gradient(rates, 1 / RATE, axis=0)
    squares = thrust[:, None] / 4 + (moment[:, :1] * -np.sin(ANGLES) + moment[:, 1:2] * np.cos(ANGLES)) / 20
    squares = squares - moment[:, 2:] * SPINS / 60
    speeds = np.sqrt(np.maximum(squares, 0.1) / 1e-5)
    return t, position, velocity, rotation, rates, speeds


def table(world="ENU", body="FLU", seed=0):
    t, position, velocity, rotation, rates, speeds = motion(seed)
    to_world = {
        "ENU": np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]),
        "NWU": np.diag([1.0, -1, -1]),
        "NED": np.eye(3),
    }[world]
    turned = {"FLU": np.diag([1.0, -1, -1]), "FRD": np.eye(3)}[body]
    quaternion = Rotation.from_matrix(to_world @ rotation.as_matrix() @ turned).as_quat()
    frame = pd.DataFrame({"t": t})
    frame[["x", "y", "z"]] = position @ to_world.T
    frame[["vx", "vy", "vz"]] = velocity @ to_world.T
    frame[["qx", "qy", "qz", "qw"]] = quaternion
    frame[["wx", "wy", "wz"]] = rates @ turned
    frame[["a", "b", "c", "d"]] = speeds * 60 / (2 * np.pi)
    return frame


def columns(world="ENU", body="FLU", **changes):
    return {
        "time": "t",
        "frame": {"world": world, "body": body},
        "position": ["x", "y", "z"],
        "velocity": ["vx", "vy", "vz"],
        "attitude": {"columns": ["qx", "qy", "qz", "qw"], "order": "xyzw"},
        "rates": ["wx", "wy", "wz"],
        "motors": {"columns": ["a", "b", "c", "d"], "quantity": "rpm", "frame": "quad/x"},
        "mass": 1.2,
        **changes,
    }


@pytest.mark.parametrize(("world", "body"), [("ENU", "FLU"), ("NWU", "FRD"), ("NED", "FRD"), ("NED", "FLU")])
def test_every_frame_gives_the_same_motion(world, body):
    read = read_motion(table(world, body), columns(world, body))
    _, position, velocity, rotation, rates, speeds = motion()
    assert np.allclose(read.position, position, atol=1e-9)
    assert np.allclose(read.velocity, velocity, atol=1e-9)
    assert np.allclose(Rotation.from_quat(read.quaternion, scalar_first=True).as_matrix(), rotation.as_matrix())
    assert np.allclose(read.rates, rates, atol=1e-9)
    assert np.allclose(read.motors, speeds)


def test_experiment_counts_up_from_its_first_sample():
    record = Experiment.from_table(table(), columns())
    _, position, *_ = motion()
    assert record.input_names == ("m1", "m2", "m3", "m4")
    assert record.units["m1"] == "rad/s"
    assert np.allclose(record.y, (position - position[0]) * [1, 1, -1])


def test_what_stands_on_the_ground_is_left_out():
    """Motors that stand show where the ground is; without them nothing is taken for it."""
    flight = table()
    ground = [flight.iloc[[at] * 300].assign(z=flight["z"].min() - 0.5, a=0.0, b=0.0, c=0.0, d=0.0) for at in (0, -1)]
    for landing in ground:
        landing[["vx", "vy", "vz", "wx", "wy", "wz"]] = 0.0
    whole = pd.concat([ground[0], flight, ground[1]], ignore_index=True)
    whole["t"] = np.arange(len(whole)) / RATE
    read = read_motion(whole, columns())
    assert (read.t[0], read.t[-1]) == pytest.approx((3.0, 3.0 + flight["t"].iloc[-1]), abs=0.05)
    assert any("stands on the ground for 6.0 s" in finding.reason for finding in read.findings)
    assert len(read_motion(flight, columns()).t) == len(flight)


def write_table(frame, path):
    """Write a table as the end of its file's name says."""
    if path.suffix == ".parquet":
        frame.to_parquet(path)
    elif path.suffix == ".mat":
        savemat(path, {name: frame[name].to_numpy()[:, None] for name in frame}, do_compression=True)
    else:
        frame.to_csv(path, index=False)


@pytest.mark.parametrize("suffix", [".csv.xz", ".parquet", ".mat"])
def test_every_kind_of_file_gives_the_same_table(tmp_path, suffix):
    frame = table().head(1000)
    path = tmp_path / f"flight{suffix}"
    write_table(frame, path)
    description = tmp_path / "columns.yaml"
    description.write_text(yaml.safe_dump(columns()), encoding="utf-8")
    read = read_motion(path, description)
    assert np.allclose(read.position, read_motion(frame, columns()).position, atol=1e-9)


def write_matlab_hdf5(path, arrays):
    """Write arrays as MATLAB's `save -v7.3` does: HDF5 behind MATLAB's header, axes in reverse, a class on each."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=np.asarray(values).T).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("note", data=np.array([[104], [105]], np.uint16)).attrs["MATLAB_class"] = np.bytes_("char")
        file.create_group("settings").create_dataset("mass", data=[[1.2]])
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def test_matlab_files_of_version_7_3_are_read(tmp_path):
    frame, path = table(), tmp_path / "flight.mat"
    packed = {name: frame[name].to_numpy()[:, None] for name in frame if name not in "xyz"}
    write_matlab_hdf5(path, packed | {"p": frame[["x", "y", "z"]].to_numpy()})
    read = read_motion(path, columns(position="p"))
    assert np.allclose(read.position, motion()[1], atol=1e-9)
    assert np.allclose(read.rates, motion()[4], atol=1e-9)


def test_a_damaged_matlab_file_of_version_7_3_is_refused(tmp_path):
    path = tmp_path / "flight.mat"
    write_matlab_hdf5(path, {"t": np.arange(100.0)[:, None]})
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(TableError, match="not a readable MATLAB file"):
        read_motion(path, columns())


@pytest.mark.parametrize("suffix", [".csv.gz", ".csv.xz", ".csv.bz2", ".parquet", ".mat"])
def test_damaged_files_are_refused_or_read_whatever_the_libraries_raise(tmp_path, suffix):
    """A flipped byte in a packed table ended in an LZMAError, a zlib.error or an IndexError of SciPy."""
    path, rng = tmp_path / f"table{suffix}", np.random.default_rng(19)
    frame = pd.DataFrame(rng.normal(size=(200, 3)), columns=["x", "y", "z"])
    write_table(frame, path)
    whole, said = path.read_bytes(), list[str]()
    for _ in range(40):
        damaged = bytearray(whole)
        for at in rng.integers(4, len(whole), 3):
            damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            read_columns(path)
        except TableError as error:
            said.append(str(error))
    assert said
    assert all(path.name in sentence for sentence in said)


@pytest.mark.parametrize("suffix", [".csv.gz", ".csv.xz", ".csv.bz2", ".parquet", "5.mat", "73.mat"])
def test_a_packed_table_may_not_unpack_beyond_what_a_log_may(tmp_path, suffix, limit_unpacked):
    """A few kilobytes that unpack to a hundred times as much, as zeros do, fill the memory of a computer."""
    path, rows = tmp_path / f"bomb{suffix}", 200_000
    if suffix == "73.mat":
        with h5py.File(path, "w", userblock_size=512) as file:
            file.create_dataset("t", shape=(1, rows), dtype=np.float64, compression="gzip")
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    else:
        write_table(pd.DataFrame({"t": np.zeros(rows)}), path)
    assert len(read_columns(path)) == rows
    assert path.stat().st_size < 20_000
    limit_unpacked(500_000)
    with pytest.raises(RotoridError, match=r"bomb.*(more than|of numbers, more than)"):
        read_columns(path)


@pytest.mark.parametrize("cell", ["[" + "-" * 60_000 + "1]", "[" + "-" * 3000 + "1]", "[1" + "0" * 400 + "]"])
def test_a_cell_that_python_cannot_take_for_a_list_is_no_list(tmp_path, cell):
    """Signs nested too deep ended in a MemoryError or RecursionError, an integer beyond all floats in another."""
    path = tmp_path / "table.csv"
    path.write_text(f't,p\n1,"{cell}"\n2,"[1]"\n')
    assert np.array_equal(read_columns(path)["p[0]"], [np.nan, 1.0], equal_nan=True)


def test_lists_that_would_fill_the_memory_are_refused(tmp_path, limit_unpacked):
    """One long list makes a column for each of its numbers, in every row: 1 MB of text asked for 298 GB."""
    path = tmp_path / "table.csv"
    path.write_text("t,p\n" + '1,"[' + ",".join("0" * 1000) + ']"\n' + "1,[]\n" * 1000)
    limit_unpacked(5_000_000)
    with pytest.raises(TableError, match="column p: lists of up to 1000 numbers in 1001 rows"):
        read_columns(path)


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_a_header_of_another_table_does_not_fill_the_memory(tmp_path, end):
    """A hundred thousand rows of one number below a header of five thousand columns made 4 GB of 11 MB."""
    path = tmp_path / "table.csv"
    path.write_text("," * 5000 + end + f"1{end}" * 20_000)
    with pytest.raises(TableError, match="the header names 5001 columns"):
        read_columns(path)
    path.write_text(f"a,b{end}")
    with pytest.raises(TableError, match="no rows"):
        read_columns(path)
    path.write_text(end.join([",".join("tabc"), *[",".join("1234")] * 3, ""]))
    assert read_columns(path).shape == (3, 4)


def test_a_parquet_file_whose_statistics_are_damaged_is_refused(tmp_path):
    """PyArrow ends the process where the facts of a column are looked at that contradict the schema (26.0)."""
    path = tmp_path / "table.parquet"
    pd.DataFrame({"t": np.arange(20.0), "p": [[1.0, 2.0]] * 20}).to_parquet(path)
    whole = path.read_bytes()
    footer = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    for at in range(footer, footer + 60):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with suppress(TableError):
            read_columns(path)


def test_lists_in_cells_are_vectors(tmp_path):
    frame = table()
    packed = pd.DataFrame({"t": frame["t"], "p": frame[["x", "y", "z"]].to_numpy().tolist()})
    packed = packed.join(frame.drop(columns=["t", "x", "y", "z"]))
    path = tmp_path / "lists.csv"
    packed.to_csv(path, index=False)
    assert np.allclose(read_motion(path, columns(position="p")).position, motion()[1], atol=1e-6)


def without(*names):
    return {name: value for name, value in columns().items() if name not in names}


def scaled(names, factor):
    """Return what multiplies columns by a factor."""
    return lambda frame: frame.assign(**{name: factor * frame[name] for name in names.split()})


def swapped(one, other):
    return lambda frame: frame.rename(columns={one: other, other: one})


def in_rows(name, rows, value):
    """Return what writes a value into some rows of a column."""
    return lambda frame: frame.assign(**{name: frame[name].where(~frame.index.isin(rows), value)})


def in_angles(angle):
    """Return what gives the attitude as angles in radians, one of which is in degrees."""

    def change(frame):
        angles = Rotation.from_quat(frame[["qx", "qy", "qz", "qw"]]).as_euler("ZYX")[:, ::-1]
        frame[["roll", "pitch", "yaw"]] = angles
        return frame.assign(**{angle: np.degrees(frame[angle])})

    return change


def as_it_is(frame):
    return frame


def doubtful(frame, described=None):
    """Return what is found doubtful about a table."""
    findings = read_motion(frame, described or columns()).findings
    return [finding for finding in findings if finding.id == "table-doubtful"]


def test_missing_velocity_and_rates_are_derived():
    """A millimetre of noise is 10 m/s^2 from sample to sample, and does not hide that motors lift."""
    read = read_motion(table(), without("velocity", "rates"))
    assert np.abs(read.velocity - motion()[2])[5:-5].max() < 0.05
    assert np.abs(read.rates - motion()[4])[5:-5].max() < 0.05
    noisy = table()
    noisy[["x", "y", "z"]] += 1e-3 * np.random.default_rng(0).standard_normal((len(noisy), 3))
    read_motion(noisy, without("velocity", "rates"))


QUATERNION = {"columns": ["qx", "qy", "qz", "qw"], "order": "xyzw"}
MOTORS = {"columns": ["a", "b", "c", "d"], "quantity": "rpm", "frame": "quad/x"}
IN_RADIANS = {"columns": ["roll", "pitch", "yaw"], "unit": "rad"}

#: What changes a table, its description, and the words by which the two are refused.
REFUSED = {
    "world": (as_it_is, columns(world="NED"), "body"),
    "turned place": (
        lambda frame: frame.assign(x=frame["y"], y=-frame["x"], vx=frame["vy"], vy=-frame["vx"]),
        columns(),
        "the heading of the world's frame is wrong",
    ),
    "body": (as_it_is, columns(body="FRD"), "not up"),
    "order": (as_it_is, columns(attitude=QUATERNION | {"order": "wxyz"}), "qx, qy, qz, qw"),
    "direction": (
        as_it_is,
        columns(attitude=QUATERNION | {"direction": "world-to-body"}),
        "world-to-body would fit|are not the changes",
    ),
    "rates in deg": (as_it_is, columns(rates={"columns": ["wx", "wy", "wz"], "unit": "deg/s"}), "deg for rad"),
    "position in mm": (as_it_is, columns(position={"columns": ["x", "y", "z"], "unit": "mm"}), "mm for m"),
    "velocity in body": (as_it_is, columns(velocity={"columns": ["vx", "vy", "vz"], "axes": "body"}), "vx, vy, vz"),
    "commands": (as_it_is, columns(motors=MOTORS | {"quantity": "command"}), "a, b, c, d.*cannot be command"),
    "no such column": (as_it_is, columns(rates=["wx", "wy", "w_z"]), r"no column w_z \(is it wz\?\)"),
    "no such key": (as_it_is, columns(positon=["x", "y", "z"]), "unknown key positon; do you mean position"),
    "no such world": (as_it_is, columns(frame={"world": "XYZ"}), "must be one of NED, ENU, NWU"),
    "mass": (as_it_is, columns(mass=-1), "positive number"),
    "poles": (as_it_is, columns(motors=MOTORS | {"quantity": "erpm"}), "poles"),
    "three motors": (as_it_is, columns(motors=MOTORS | {"columns": ["a", "b", "c"]}), "takes 4 columns, not 3"),
    "no places": (as_it_is, columns(motors=MOTORS | {"frame": None}), "frame .* or their places"),
    "spin": (as_it_is, columns(motors={"columns": ["a"], "quantity": "rpm", "places": [[1, 0, "up"]]}), "cw or ccw"),
    "pwm": (as_it_is, columns(motors=MOTORS | {"quantity": "pwm", "pwm": [1000, [2000]]}), "widths of idle and full"),
    "named twice": (as_it_is, columns(motors=MOTORS | {"columns": list("abcc")}), "motors names a column twice"),
    "motors a and b": (swapped("a", "b"), columns(), "in the order b, a, c, d they would"),
    "mirrored": (scaled("wx", -1.0), columns(), r"rates as \(-x, y, z\) would fit"),
    "mostly missing": (in_rows("c", range(300, 3000), np.nan), columns(fill=True), "column c: 90 % of the samples are"),
    "milliseconds": (scaled("t", 1000.0), columns(), "column t: .*samples are 10 s apart"),
    "twice the time": (scaled("t", 2.0), columns(), "a unit is wrong"),
    "roll in deg": (in_angles("roll"), without("rates") | {"attitude": IN_RADIANS}, "column roll: a lean of"),
    "yaw in deg": (in_angles("yaw"), without("rates") | {"attitude": IN_RADIANS}, "the heading is wrong"),
    "quaternion": (lambda frame: frame.assign(qw=frame["qx"]), columns(), "qx, qy, qz, qw"),
    "qx too small": (scaled("qx", 0.8), columns(), "column qx: with 1.25 times these values"),
    "all in mm": (scaled("x y z vx vy vz", 1000.0), columns(), r"speeds up 9\d\d times .* its lean says.*mm for m"),
    "all in feet": (scaled("x y z vx vy vz", 3.28), columns(), r"speeds up 3\.\d+ times as much as its lean says"),
    "x in cm": (scaled("x", 100.0), columns(), "the unit of one column is wrong"),
    "z in feet": (scaled("z", 3.28), columns(), "the unit of one column is wrong"),
    "still x": (scaled("x", 0.0), columns(), "position stand still along E"),
    "still wx": (scaled("wx", 0.0), columns(), "rates stand still along x"),
    "backwards": (scaled("a b c d", -1.0), columns(), "below zero; give its size"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_with_its_column(case):
    change, described, message = REFUSED[case]
    with pytest.raises(TableError, match=message):
        read_motion(change(table()), described)


#: What changes a table, and the column that is then named; all else is mended, or cut out.
NAMED = {
    "repeated time": (lambda frame: in_rows("t", range(500, 521), frame["t"][500])(frame), "t"),
    "jump": (lambda frame: frame.assign(t=frame["t"] + 5.0 * (frame.index >= 1000)), "t"),
    "back": (lambda frame: frame.assign(t=frame["t"] - 4.0 * (frame.index >= 1000)), "t"),
    "gap": (in_rows("wy", range(1000, 1201), np.nan), "wy"),
    "spike": (in_rows("b", [400, 900], 4e6), "b"),
    # Lively motors: zeros are no farther off than other steps.
    "lost": (
        lambda frame: in_rows("b", [400, 900], 0.0)(
            scaled("a b c d", np.random.default_rng(1).uniform(0.9, 1.1, len(frame)))(frame)
        ),
        "b",
    ),
    "norm": (scaled("qx qy qz qw", 1.04), "qx, qy, qz, qw"),
    "held": (lambda frame: in_rows("a", range(500, 621), frame["a"][500])(frame), "a"),
    "weak": (scaled("b", 3.0), "b"),
    "slow": (scaled("t", 1.1), "t"),
}


@pytest.mark.parametrize("case", NAMED)
def test_damage_is_cut_out_or_mended_and_named(case):
    change, column = NAMED[case]
    read = read_motion(change(table()), columns(fill=case == "weak"))
    assert column in [finding.evidence.get("column") for finding in read.findings if finding.id == "table-doubtful"]
    assert np.isfinite(read.motors).all()
    assert np.isfinite(read.rates).all()
    assert read.motors.max() < 1e4
    assert np.allclose(np.diff(read.t), np.diff(read.t)[0])


@pytest.mark.parametrize("seed", range(3))
def test_a_sound_table_raises_nothing(seed):
    assert not doubtful(table(seed=seed))


def test_motors_that_only_partly_turn_the_craft_are_named_where_another_order_fits_better():
    """Elevons pitch a tail-sitter more than its motors do: front and rear exchanged passed without a word."""
    frame = table()
    squares = frame[["a", "b", "c", "d"]].to_numpy() ** 2
    pitching = squares @ np.cos(ANGLES) / 2.0
    others = pitching.std() * np.sin(2 * np.pi * 0.9 * frame["t"] ** 1.05)
    frame[["a", "b", "c", "d"]] = np.sqrt(np.maximum(squares + np.outer(2.0 * others, np.cos(ANGLES)), 0.0))
    assert not read_motion(frame, columns()).findings
    [finding] = read_motion(swapped("a", "d")(swapped("b", "c")(frame)), columns()).findings
    assert (finding.id, str(finding.severity)) == ("table-doubtful", "warning")
    assert "in the order d, c, b, a the motors would turn the craft better" in finding.reason


@pytest.mark.parametrize("rows", [4, -10])
@pytest.mark.parametrize(
    ("group", "shift"),
    [("vx vy vz", "vx vy vz"), ("wx wy wz", "wx wy wz"), ("qx qy qz qw", "wx wy wz"), ("x y z", "vx vy vz")],
)
def test_columns_of_another_clock_are_named_with_their_shift(group, shift, rows):
    """Either column of a pair may be the late one; the sentence says which is late against which."""
    frame = table()
    frame[group.split()] = frame[group.split()].shift(rows).bfill().ffill()
    [finding] = doubtful(frame)
    late = rows if group == shift else -rows
    assert finding.evidence["column"] == shift.replace(" ", ", ")
    # Positions here are running sums of velocities, which are half a sample late.
    assert finding.evidence["seconds"] == pytest.approx(late / RATE, abs=0.6 / RATE)


def test_an_attitude_of_another_clock_is_named_where_there_are_no_rates():
    frame = table()
    frame[["qx", "qy", "qz", "qw"]] = frame[["qx", "qy", "qz", "qw"]].shift(6).bfill()
    [finding] = doubtful(frame, without("rates"))
    assert finding.evidence["column"] == "qx, qy, qz, qw"
    assert finding.evidence["seconds"] == pytest.approx(0.06, abs=0.01)


def test_signs_of_quaternions_may_change_at_any_sample():
    """Opposite quaternions are one attitude; recorders that keep w positive flip signs in the middle of a turn."""
    frame, clean = table(), read_motion(table(), columns())
    flips = np.where(np.random.default_rng(0).random(len(frame)) < 0.3, -1.0, 1.0)
    frame[["qx", "qy", "qz", "qw"]] *= flips[:, None]
    frame.loc[200:204, "qx"] = np.nan  # five samples of 10 ms: filled from their neighbours
    read = read_motion(frame, columns())
    turned = Rotation.from_quat(read.quaternion) * Rotation.from_quat(clean.quaternion).inv()
    assert turned.magnitude().max() < 1e-3


def test_angles_that_wrap_are_no_leaps():
    frame = table()
    angles = Rotation.from_quat(frame[["qx", "qy", "qz", "qw"]]).as_euler("ZYX", degrees=True)
    frame["pitch"], frame["roll"] = angles[:, 1], angles[:, 2]
    frame["yaw"] = (angles[:, 0] + 150.0 + 180.0) % 360.0 - 180.0
    assert np.ptp(frame["yaw"]) > 350.0
    frame["t"] += 0.3 * 0.01 * np.sin(np.arange(len(frame)))  # unsteady stamps: resampled
    turn = Rotation.from_euler("z", 150.0, degrees=True)
    frame[["x", "y", "z"]] = turn.apply(frame[["x", "y", "z"]])
    frame[["vx", "vy", "vz"]] = turn.apply(frame[["vx", "vy", "vz"]])
    described = columns(attitude={"columns": ["roll", "pitch", "yaw"], "kind": "angles", "unit": "deg"})
    read, clean = read_motion(frame, described), read_motion(table(), columns())
    turned = Rotation.from_quat(read.quaternion, scalar_first=True).as_euler("ZYX")[:, 1:]
    truth = Rotation.from_quat(clean.quaternion, scalar_first=True).as_euler("ZYX")[:, 1:]
    assert np.abs(turned[5:-5] - truth[5:-5]).max() < 0.03


def test_commands_that_stand_still_are_no_held_telemetry():
    """PWM is a whole number of microseconds: in a calm hover it stays for half a second."""
    frame = table()
    names = ["a", "b", "c", "d"]
    frame[names] = np.round(1000.0 + 500.0 * frame[names] / frame[names].mean())
    frame.loc[500:620, "a"] = frame["a"][500]
    assert not doubtful(frame, columns(motors=MOTORS | {"quantity": "pwm"}))


@pytest.mark.parametrize(("separator", "decimal"), [(";", "."), (";", ","), ("\t", ",")])
def test_separators_and_decimal_commas_of_spreadsheets_are_read(tmp_path, separator, decimal):
    path = tmp_path / "flight.csv"
    table()[:300].to_csv(path, sep=separator, decimal=decimal, index=False)
    assert np.allclose(read_columns(path), table()[:300])


@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%S.%f", "%d/%m/%Y %H:%M:%S.%f", "%H:%M:%S.%f"])
def test_dates_and_times_of_day_are_times(form):
    frame = table()
    frame["t"] = pd.to_datetime(1.7e9 + frame["t"], unit="s").dt.strftime(form)
    read = read_motion(frame, columns())
    assert np.allclose(read.t - read.t[0], table()["t"], atol=1e-6)


def test_a_column_that_stands_in_the_table_twice_is_refused(tmp_path):
    """Which of the two is meant is not known; the first was taken."""
    path = tmp_path / "flight.csv"
    twice = pd.concat([table(), table()[["x"]]], axis=1)
    twice.to_csv(path, index=False)
    for source in (twice, path):
        with pytest.raises(TableError, match="column x stands in the table more than once"):
            read_motion(source, columns())


def test_fast_tables_are_checked_at_the_rate_of_motion():
    """At 4 kHz the checks took half a minute and gigabytes; motors are still held against the turns."""
    slow = table().head(1000)
    t = np.arange(0.0, slow["t"].iloc[-1], 1.0 / 4000.0)
    fast = pd.DataFrame({name: np.interp(t, slow["t"], slow[name]) for name in slow})
    assert len(read_motion(fast, columns()).t) == len(t)
    with pytest.raises(TableError, match="in the order b, a, c, d they would"):
        read_motion(swapped("a", "b")(fast), columns())


@pytest.mark.parametrize("velocity", [True, False])
def test_feet_along_the_vertical_are_named_by_the_thrust(velocity):
    """Position and velocity agree, and attitude says nothing of it."""
    described = columns() if velocity else without("velocity")
    assert not doubtful(table(), described)
    (finding,) = doubtful(scaled("z vz" if velocity else "z", 3.28)(table()), described)
    assert finding.evidence["column"] == ("z, vz" if velocity else "z")
    assert finding.evidence["change"] == pytest.approx(3.28, rel=0.15)


def test_a_chirp_after_calm_is_no_spike_and_a_lost_sample_in_it_is_one():
    """Of exported chirps a tenth of the samples was replaced by their neighbours."""
    t = np.arange(3000) / 50.0
    calm = 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    rate = calm + np.where(t > 55.0, np.sin(2.0 * np.pi * 10.0 * t), 0.0)
    assert without_spikes(rate[:, None], ("wx",))[1] == []
    rate[[1000, 2900]] = 5.0, 50.0
    (finding,) = without_spikes(rate[:, None], ("wx",))[1]
    assert "2 samples leap away" in finding.reason


@pytest.mark.filterwarnings("error")
def test_a_quarter_of_a_second_is_too_short_to_tell_what_motors_do():
    short = table().head(60)
    findings = doubtful(short.assign(t=0.4 * short.t), without("velocity", "rates"))
    assert not any("grow with the motors" in finding.reason for finding in findings)
