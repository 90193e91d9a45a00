"""Measurement files: what is read is what stands there, and what cannot be used is refused with its place."""

import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st
from support.file_examples import INTERFEROMETER, PART, TRACKER
from support.tiers import drawn

import machines
from calibration.instruments import Interferometer, LaserTracker, Part
from calibration.measurement.file import in_space, read_measurement
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.measurement.written_file import write_measurement
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.user_error import UserError

GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")


@pytest.fixture
def read(tmp_path, monkeypatch):
    """Reads a text as a measurement file `m.csv`."""
    monkeypatch.chdir(tmp_path)

    def read_text(text: str | bytes, machine=GANTRY) -> Measurement:
        Path("m.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_measurement(Path("m.csv"), machine)

    return read_text


def written(measurement: Measurement) -> bytes:
    file = io.BytesIO()
    write_measurement(measurement, file)
    assert not file.closed
    return file.getvalue()


def assert_same(one: Measurement, other: Measurement) -> None:
    """All that a file holds, to the last bit."""
    assert one.machine == other.machine
    assert one.instrument == other.instrument
    assert list(one.targets.items()) == list(other.targets.items())
    assert (one.stands_on, one.part_zero) == (other.stands_on, other.part_zero)
    for name in ("observed", "axis", "run", "actual", "feed"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    for name in ("positions", "approach", "last_move", "time", "cycle", "station", "target", "observed"):
        np.testing.assert_array_equal(getattr(one.state, name), getattr(other.state, name), name)
    assert one.state.temperatures.keys() == other.state.temperatures.keys()
    for name, column in one.state.temperatures.items():
        np.testing.assert_array_equal(column, other.state.temperatures[name])


# ---- what is read


def test_laser_tracker(read):
    m = read(TRACKER)
    assert m.instrument == LaserTracker(0.0, 0.25, 5.0, 1.0)
    assert m.targets == {"t1": Target((0, 0, -120)), "t2": Target((90, 40, -180))}
    assert m.state.positions.tolist() == [[0, 0, 0], [500, 0, 0], [200, 0, 0]]
    assert m.state.time is not None
    assert m.state.time.tolist() == [0, 8, 16]
    assert m.state.temperatures["scale"].tolist() == [0, 0.5, 1]
    assert m.state.approach is not None
    assert m.state.approach.tolist() == [[0, 0, 0], [1, 0, 0], [-1, 0, 0]]
    assert m.state.last_move is not None
    assert m.state.last_move[:, 0].tolist() == [0, 500, -300]
    assert m.tool.tolist() == [[0, 0, -120], [90, 40, -180], [0, 0, -120]]
    assert m.observed[0].tolist() == [-110.73612, -3221.43193, -862.87697]
    np.testing.assert_array_equal(m.observed, m.state.observed)
    assert (m.notes, m.source, m.where(2)) == ((), "m.csv", "m.csv:11")
    assert len(m.fingerprint) == 12
    assert m.groups.tolist() == ["1", "1", "1"]


def test_optional_columns(read):
    m = read(
        "# machine: dmu50\n# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 5\n# stands_on: bed\n"
        "# table.r1: 100 0 0\n# bed.r2: 0 0 5\n# target.t: 0 0 -10\n"
        "station,run,B,C,X,Y,Z,x,y,z,feed,actual_B,actual_X,dir_X,target\n"
        "S1,b,90,180,1,2,3,7,8,9,0,90.5,1.001,-1,r1\n"
        "S2,a,90,180,1,2,3,7,8,9,1200,90.5,1.001,1,r2\n"
        "S2,b,90,180,2,2,3,7,8,9,0,90.5,2.001,1,t\n",
        DMU50,
    )
    np.testing.assert_allclose(m.state.positions[0], [math.pi, math.pi / 2, 1, 2, 3], rtol=1e-15)
    assert {name: target.carrier for name, target in m.targets.items()} == {"r1": "table", "r2": "bed", "t": "tool"}
    assert m.stands_on == "bed"
    assert m.run is not None
    assert m.run.tolist() == ["b", "a", "b"]
    assert m.state.cycle is not None
    assert m.state.cycle.tolist() == [0, 1, 0]
    assert m.groups.tolist() == ["S1", "S2", "S2"]
    assert m.feed is not None
    assert m.feed.tolist() == [0, 1200, 0]
    assert m.actual is not None
    np.testing.assert_allclose(m.actual[0], [math.nan, math.radians(90.5), 1.001, math.nan, math.nan], rtol=1e-15)
    assert m.state.approach is not None
    assert m.state.approach[:, 2].tolist() == [-1, 1, 1]
    assert m.rows(slice(1, 2)).feed == [1200]


def test_speed_of_the_spindle(read):
    m = read(replaced(TRACKER, ("temp_scale", "spindle_rpm"), ("20.50", "12000")))
    assert m.state.spindle_speed.tolist() == [20.0, 12000.0, 21.0]
    assert not m.notes
    timeless = read(replaced(TRACKER, ("temp_scale", "spindle_rpm"), ("time_s", "temp_bed")))
    assert timeless.notes == ("the speed of the spindle is not used: its heat needs the column time_s",)


def test_interferometer(read):
    m = read(INTERFEROMETER, DMU50)
    assert m.instrument == Interferometer(0.3, 0.5)
    np.testing.assert_allclose(m.observed[:, 0], [0.5e-3, 1.5e-3, -2.25e-3, 1e-3, 12.5e-6], rtol=1e-15)
    turn = math.pi / 6
    np.testing.assert_allclose(
        m.state.positions,
        [[turn, 0, -100, 0, 400], *[[turn, 0, 100, 0, 400]] * 2, [turn, 0, -100, 0, 400], [math.pi / 2, 0, 0, 0, 400]],
    )
    assert m.state.approach is not None
    assert m.state.approach[:4, 2].tolist() == [1, 1, -1, -1]
    assert m.state.approach[4, 0] == 1
    assert m.groups.tolist() == ["X 1", "X 1", "X 1", "X 2", "C 1"]
    assert m.tool[0].tolist() == [0, 0, -50]
    assert m.notes == (
        "no column of B, X, Y, Z: the home position is used (B 0, X 0, Y 0, Z 400 mm, deg) in runs of other axes",
    )


def test_part(read):
    m = read(PART)
    assert m.instrument == Part(2.5, 0.0, 2)
    assert m.state.positions.tolist() == [[500, 600, 400], [510, 600, 400]]
    assert m.observed.tolist() == [[0.001, 0.002], [10.003, 0.004]]
    assert m.state.approach is None  # the order of measuring is not that of machining
    assert m.part_zero == (500, 600, 300)
    assert len(m.notes) == 2


def test_part_on_a_swivelled_machine(tmp_path):
    """Linear axes put the tool point on the nominal features wherever the rotary ones have their home."""
    text = (
        (machines.FOLDER / "trunnion_bc.toml")
        .read_text()
        .replace("travel = [-110, 110]", "travel = [-110, 110]\nhome = 30")
    )
    machine = machines.parse(text.replace("travel = [-inf, inf]", "travel = [-inf, inf]\nhome = 200"), "m")
    path = tmp_path / "m.csv"
    path.write_text(
        "# instrument: part\n# u_um: 1\n# target.t: 5 7 -80\n# part_offset: 10 20 30\n"
        "nominal_x,nominal_y,nominal_z,x,y,z\n1,2,3,0,0,0\n-40,50,6,0,0,0\n"
    )
    m = read_measurement(path, machine)
    seen = tool_point(machine, m.state.positions, m.tool)
    np.testing.assert_allclose(seen, [[11, 22, 33], [-30, 70, 36]], atol=1e-10)
    np.testing.assert_allclose(m.state.positions[:, :2] / machine.scale[:2], [[200, 30], [200, 30]])


def test_part_with_positions(read):
    columns = "X,Y,Z,nominal_x,nominal_y,x,y\n100,100,50,0,0,0,0\n110,100,50,10,0,10,0\n110,110,50,10,10,10,10\n"
    header = "# machine: gantry\n# instrument: part\n# u_um: 1\n# target.t1: 0 0 -100\n"
    m = read(header + columns)
    assert m.state.positions.tolist() == [[100, 100, 50], [110, 100, 50], [110, 110, 50]]
    assert m.part_zero == (100, 100, -50)
    assert m.notes == ()
    assert "differ by up to" in read(header + columns.replace("110,110,50", "110,110.5,50")).notes[0]


def test_encodings_and_ends_of_lines(read):
    plain = read(TRACKER)
    for text in (
        b"\xef\xbb\xbf" + TRACKER.encode(),
        TRACKER.replace("\n", "\r\n").encode(),
        (TRACKER + "\n  \n\n").encode(),
        TRACKER.rstrip("\n").encode(),
        TRACKER.replace(",", " , ").encode(),
        TRACKER.replace("t1,", '"t1",').encode(),
        ("\n" + TRACKER).encode(),
    ):
        assert_same(read(text), plain)


def test_what_is_taken_for_granted_is_noted(read):
    m = read(
        "# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 5\n# operator: NN\n# u_rnge_um: 3\n# a remark\n"
        "# strategy: grid\n# minutes: 25.0\n"
        "time_s,X,x,y,z\n5,10,1,2,3\n4,5001,1,2,3\n"
    )
    assert m.notes == (
        "the file names no machine: it is read as data of gantry",
        "line 4: header key 'operator' is unknown, and ignored",
        "line 5: header key 'u_rnge_um' is unknown, and ignored",
        "line 6: 'a remark' is not 'key: value', and is ignored",
        "the header gives no target: it is assumed in the tool reference point (spindle nose)",
        "no column of Y, Z: the home position is used (Y 0, Z 1500 mm)",
        "line 11: the time decreases; the rows keep the order of the file",
        "X leaves its travel 0..5000 mm by 1 mm: are these machine coordinates?",
    )
    assert m.targets == {"1": Target((0, 0, 0))}


# ---- what is refused


def replaced(text: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


BROKEN = [
    (TRACKER, [("machine: gantry", "machine: dmu50")], "m.csv:1 machine: the file is of 'dmu50', not of gantry"),
    (TRACKER, [("# instrument: laser-tracker\n", "")], "'# instrument: laser-tracker | interferometer | part | touch-probe | ballbar | level | lengths | ranging' is missing"),
    (TRACKER, [("laser-tracker", "lasertracker")], "m.csv:2 instrument: 'lasertracker' is none of laser-tracker, interferometer, part"),
    (TRACKER, [("# u_range_um_per_m: 0.25\n", "")], "uncertainty (k=1) of the laser-tracker is missing: state u_range_um or u_range_um_per_m above zero (header line '# u_range_um: ...')"),
    (TRACKER, [("0.25", "0")], "state u_range_um or u_range_um_per_m"),
    (TRACKER, [("0.25", "-1")], "m.csv:3 u_range_um_per_m: -1 is negative"),
    (TRACKER, [("0.25", "0.25 um")], "m.csv:3 u_range_um_per_m: expected a number, got '0.25 um'"),
    (TRACKER, [("0.25", "nan")], "m.csv:3 u_range_um_per_m: expected a number, got 'nan'"),
    (TRACKER, [("0 0 -120", "0 -120")], "m.csv:6 target.t1: expected 3 numbers, got '0 -120'"),
    (TRACKER, [("target.t2", "target.t1")], "m.csv:7 target.t1: given before, in line 6"),
    (TRACKER, [("target.t2", "table.t1")], "m.csv:7 table.t1: the name of target t1 occurs twice"),
    (TRACKER, [("target.t2", "target")], "m.csv:7 target: expected target.<name>, the name without blanks"),
    (TRACKER, [("target.t2", "target.t 2")], "the name without blanks"),
    (TRACKER, [("# target.t1: 0 0 -120\n", "# stands_on: floor\n# target.t1: 0 0 -120\n")], "m.csv:6 stands_on: expected workpiece or bed, got 'floor'"),
    (TRACKER, [("# target.t1: 0 0 -120\n# target.t2: 90, 40, -180\n", "")], "m.csv:6 column target: the header gives the position of no target"),
    (TRACKER, [(",t2,", ",t3,")], "m.csv:10 column target: 't3' is not in the header, which has t1, t2"),
    (TRACKER, [(",target", ""), (",t1,", ","), (",t2,", ","), (",t1,", ",")], "m.csv:8: the header has several targets (t1, t2), but the column target is missing"),
    (TRACKER, [("temp_scale", "temp")], "m.csv:8 column temp: not known; known are x, y, z, X, Y, Z, time_s"),
    (TRACKER, [("time_s", "time")], "m.csv:8 column time: not known (did you mean time_s?)"),
    (TRACKER, [(",Z,", ",A,")], "m.csv:8 column A: not known"),
    (TRACKER, [(",Z,", ",X,")], "m.csv:8 column X: twice"),
    (TRACKER, [(",Z,", ",,")], "m.csv:8 column : without a name"),
    (TRACKER, [(",z,", ",point,")], "m.csv:8 laser-tracker: column z missing, found time_s, X, Y, Z, target, x, y, point, temp_scale"),
    (TRACKER, [("389.2", "nan")], "m.csv:10 column x: 'nan' is no number"),
    (TRACKER, [("389.2", "-inf")], "m.csv:10 column x: '-inf' is no number"),
    (TRACKER, [("389.2", "1e999")], "m.csv:10 column x: '1e999' is no number"),
    (TRACKER, [("389.2", "1_0")], "m.csv:10 column x: '1_0' is no number"),
    (TRACKER, [("389.2", "١")], "m.csv:10 column x: '١' is no number"),
    (TRACKER, [("389.2", " ")], "m.csv:10 column x: empty"),
    (TRACKER, [("389.2", "")], "m.csv:10 column x: empty"),
    (TRACKER, [(",t2,", ",,")], "m.csv:10 column target: empty"),
    (TRACKER, [("20.50", "warm")], "m.csv:10 column temp_scale: 'warm' is no number"),
    (TRACKER, [("temp_scale", "spindle_rpm"), ("20.50", "-500")], "m.csv:10 column spindle_rpm: is below 0: a speed is positive"),
    (TRACKER, [("temp_scale", "spindle_rpm"), ("20.50", "2e6")], "m.csv:10 column spindle_rpm: is more than 1e+06, and no speed"),
    (TRACKER, [("temp_scale", "spindle_rpm"), ("20.50", "")], "m.csv:10 column spindle_rpm: empty"),
    (TRACKER, [("389.2", "389,2")], "m.csv:10: 10 cells, but 9 columns have names (a decimal comma?)"),
    (TRACKER, [(",20.50", "")], "m.csv:10: 8 cells, but 9 columns have names"),
    (TRACKER, [("8.0,500.0", '8.0,"500.0')], "m.csv:10: a cell begins with a quote and has no end"),
    (TRACKER, [("8.0,500.0", "# pause\n8.0,500.0")], "m.csv:10: header lines must be above the names of columns"),
    (TRACKER, [("8.0,500.0", "\n8.0,x")], "m.csv:11 column X: 'x' is no number"),
    (TRACKER, [("machine: gantry", "machine: gantry\n# machine: gantry")], "m.csv:2 machine: given before, in line 1"),
    (INTERFEROMETER, [("u_um: 0.3", "u_um: 0")], "the interferometer is missing: state u_um above zero (header line '# u_um: ...')"),
    (INTERFEROMETER, [(",1,+1", ",1,up")], "m.csv:7 column direction: 'up' is none of +1, 1, +, forward, -1, -, backward"),
    (INTERFEROMETER, [("C,1,+", "A,1,+")], "m.csv:11 column axis: machine dmu50 (w C B b X Y Z t) has no axis 'A'"),
    (INTERFEROMETER, [("target_mm", "target_um")], "m.csv:6 column target_um: not known (did you mean target_mm?)"),
    (INTERFEROMETER, [("X,1,+1,-100", "X,1,+1,")], "m.csv:7 column target_mm: empty"),
    (INTERFEROMETER, [("X,1,+1,-100", "X,1,+1,left")], "m.csv:7 column target_mm: 'left' is no number"),
    (INTERFEROMETER, [("C,1,+,,90,,12.5", "C,1,+,90,90,,12.5")], "m.csv:11 column target_mm: must be empty for an axis of the other kind"),
    (INTERFEROMETER, [("12.5,90", "12.5,80")], "m.csv:11 column C: differs from the target of this axis"),
    (INTERFEROMETER, [("target.r", "table.r")], "only a laser tracker can have targets on the table or on the bed"),
    (INTERFEROMETER, [("axis,run,", "axis,station,")], "m.csv:6 an interferometer: column run missing"),
    (PART, [("nominal_y", "feed")], "m.csv:6 a part: column nominal_y missing"),
    (PART, [("nominal_x,nominal_y,x,y", "nominal_x,nominal_y,x,z")], "m.csv:6 part: column y missing"),
    (PART, [("500 600 300", "500 600")], "m.csv:4 part_offset: expected 3 numbers"),
    (PART, [("# u_um: 2.5\n", "")], "uncertainty (k=1) of the part is missing: state u_um above zero (header line '# u_um: ...')"),
    (PART, [("10.003", "10.003mm")], "m.csv:8 column x: '10.003mm' is no number"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "changes", "words"), BROKEN)
def test_broken_files(read, text, changes, words):
    with pytest.raises(UserError) as fault:
        read(replaced(text, *changes), DMU50 if text is INTERFEROMETER else GANTRY)
    assert words in str(fault.value)
    assert str(fault.value).startswith("m.csv")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "m.csv is empty"),
        (b"\xef\xbb\xbf \r\n\n", "m.csv is empty"),
        (b"# machine: gantry\n1,2,3.5\n4,5,6\n", "m.csv:2: the line with the names of columns above the numbers is missing"),
        (b"# machine: gantry\n\n", "m.csv: the line with the names of columns is missing"),
        (TRACKER.split("\n0.0", maxsplit=1)[0].encode(), "m.csv: there are no rows below the names of columns"),
        (TRACKER.replace(",", ";").encode(), "m.csv:8: separate cells by commas, and write numbers with a decimal point"),
        (TRACKER.encode("utf-16"), "m.csv:1: not UTF-8 text: save it as UTF-8"),
        (TRACKER.encode("utf-16-le"), "m.csv:1: a zero byte, so the file is damaged or no text: export it again"),
        ("# machine: fr\xe4se\n".encode("latin-1"), "m.csv:1: not UTF-8 text: save it as UTF-8"),
        (
            b"# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\ntime_s,x,y,z\n0,1,2,3\n",
            "data taken on the fly need the program that was run, --path PATH.nc",
        ),
        (
            b"# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\nX,dir_X,x,y,z\n0,2,1,2,3\n",
            "m.csv:5 column dir_X: 2 is not -1, 0 or 1",
        ),
        (
            b"# instrument: interferometer\n# u_um: 1\naxis,run,direction,target_deg,deviation_um\nX,1,+,5,6\n",
            "m.csv:4 column axis: a linear axis needs the column target_mm",
        ),
    ],
)  # fmt: skip
def test_files_of_another_kind(read, data, words):
    with pytest.raises(UserError, match=re.escape(words)):
        read(data)


def test_missing_file(tmp_path):
    with pytest.raises(UserError, match=r"measurement file .*none\.csv: No such file"):
        read_measurement(tmp_path / "none.csv", GANTRY)


# ---- there and back


@pytest.mark.parametrize(("text", "machine"), [(TRACKER, GANTRY), (INTERFEROMETER, DMU50), (PART, GANTRY)])
def test_round_trip_of_files(read, text, machine):
    one = read(text, machine)
    again = written(one)
    other = read(again, machine)
    assert_same(one, other)
    assert written(other) == again
    assert not other.notes


def test_names_that_a_file_cannot_hold(read):
    m = read(TRACKER)
    for name in ("a b", "a,b", "a:b", 'a"b', ""):
        state = State(m.state.positions, target=np.full(3, name))
        with pytest.raises(UserError, match="must not contain blanks"):
            written(Measurement(GANTRY, m.instrument, state, m.observed, {name: Target((0, 0, 0))}))


files_numbers = st.decimals(-9000, 9000, allow_nan=False, places=4).map(float)
anything = st.floats(-1e6, 1e6, allow_subnormal=False)
names = st.text("abcXYZ_0123456789-äß+.()", min_size=1, max_size=6).filter(lambda name: name.strip() == name)


@st.composite
def measurements(draw, exact: bool = True):
    """Measurements of any kind, with whatever columns; numbers as files have them, or any."""
    machine = draw(st.sampled_from([GANTRY, DMU50]))
    n = draw(st.integers(1, 6))
    numbers = files_numbers if exact else anything

    def column(elements=numbers):
        return np.array(draw(st.lists(elements, min_size=n, max_size=n)))

    def maybe(make):
        return make() if draw(st.booleans()) else None

    def positions():
        return np.stack([column() for _ in machine.names], axis=1) * machine.scale

    kind = draw(st.sampled_from(["tracker", "interferometer", "part"]))
    carriers = ("tool", "table", "bed") if kind == "tracker" else ("tool",)
    vectors = st.tuples(numbers, numbers, numbers)
    targets = draw(
        st.dictionaries(names, st.builds(Target, vectors, st.sampled_from(carriers)), min_size=1, max_size=3)
    )
    sizes = st.floats(0.01, 100)
    stands_on, observed, axis = "workpiece", None, None
    if kind == "tracker":
        instrument = LaserTracker(*draw(st.tuples(sizes, sizes, sizes, sizes)))
        observed = np.stack([column() for _ in range(3)], axis=1)
        stands_on = draw(st.sampled_from(["workpiece", "bed"]))
    elif kind == "part":
        instrument = Part(draw(sizes), draw(sizes), draw(st.sampled_from([2, 3])))
        observed = np.stack([column() for _ in range(instrument.components)], axis=1)
    else:
        instrument = Interferometer(draw(sizes), draw(sizes))
        axis = column(st.sampled_from(machine.names))
        turns = np.isin(axis, ("A", "B", "C"))
        observed = (column() * np.where(turns, 1e-6, 1e-3))[:, None]
    run = column(names) if kind == "interferometer" else maybe(lambda: column(names))
    time = maybe(lambda: np.sort(column()))
    cycle = None if run is None else np.array([list(dict.fromkeys(run.tolist())).index(name) for name in run.tolist()])
    sensors = draw(st.lists(names, max_size=2, unique=True))
    state = State(
        positions(),
        time=time,
        temperatures={name: np.array([v - 20.0 for v in column()]) for name in sensors},
        spindle_speed=None if time is None else maybe(lambda: np.minimum(np.abs(column()), 1e6)),
        cycle=cycle,
        station=maybe(lambda: column(names)),
        target=column(st.sampled_from(list(targets))),
        observed=in_space(observed),
    )
    signs = np.array(
        draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=n * len(machine.axes), max_size=n * len(machine.axes)))
    )
    approach = signs.reshape(n, -1) if kind == "interferometer" else maybe(lambda: signs.reshape(n, -1))
    if kind != "part":
        state = with_moves(state, approach)
    elif approach is not None:
        state = State(state.positions, approach=approach, **{
            name: getattr(state, name)
            for name in ("time", "temperatures", "spindle_speed", "cycle", "station", "target", "observed")
        })  # fmt: skip
    zero = draw(vectors) if kind == "part" else (0.0, 0.0, 0.0)
    return Measurement(
        machine, instrument, state, observed, targets, stands_on, axis, run,
        actual=maybe(positions), feed=maybe(lambda: np.abs(column())), part_zero=zero,
    )  # fmt: skip


@drawn(few=30, many=100, one=measurements())
def test_round_trip(tmp_path_factory, one):
    path = tmp_path_factory.mktemp("m") / "m.csv"
    path.write_bytes(written(one))
    other = read_measurement(path, one.machine)
    assert_same(one, other)
    assert written(other) == path.read_bytes()


@drawn(few=30, many=100, one=measurements(exact=False))
def test_round_trip_of_any_numbers(tmp_path_factory, one):
    """Angles and temperatures that no number of the file's unit gives exactly come back within rounding."""
    path = tmp_path_factory.mktemp("m") / "m.csv"
    path.write_bytes(written(one))
    other = read_measurement(path, one.machine)
    np.testing.assert_allclose(other.state.positions, one.state.positions, rtol=4e-16)
    np.testing.assert_allclose(other.observed, one.observed, rtol=4e-16)
    linear = [i for i, axis in enumerate(one.machine.axes) if not axis.rotary]
    np.testing.assert_array_equal(other.state.positions[:, linear], one.state.positions[:, linear])
    for name, column in one.state.temperatures.items():
        np.testing.assert_allclose(other.state.temperatures[name], column, rtol=4e-16, atol=4e-15)


@pytest.mark.parametrize("bad", [0, 1234, 19_999])
def test_place_of_a_bad_cell_in_a_long_file(read, bad):
    lines = [f"{i % 5000},0,0,{i},2,3" for i in range(20_000)]
    lines[bad] = "1,2,3,4,5,6,7" if bad == 0 else "1,0,0,?,2,3"
    head = "# machine: gantry\n# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\nX,Y,Z,x,y,z\n"
    with pytest.raises(UserError, match=rf"^m\.csv:{bad + 6}[: ]"):
        read(head + "\n".join(lines))


def test_the_uncertainty_of_a_straightness_grows_with_the_distance(tmp_path):
    """0.5 um and 2 um for each metre: 0.5 um at the start of the line, 0.9 um 200 mm from it."""
    path = tmp_path / "data.csv"
    path.write_text(
        "# machine: cframe\n# instrument: interferometer\n# u_um: 0.3\n# u_straightness_um: 0.5\n"
        "# u_straightness_um_per_m: 2\n# u_angle_urad: 1\n# target.t: 0 0 -90\n"
        "run,direction,X,EXX_um,EYX_um\n1,+,0,0,0\n1,+,200,2.3,-0.4\n"
    )
    measured = read_measurement(path, machines.load("cframe"))
    found = np.sqrt(measured.instrument.row_covariances(measured)[:, 0, 0])
    assert sorted(found) == pytest.approx([0.3e-3, 0.3e-3, 0.5e-3, 0.9e-3])


def test_the_uncertainty_of_a_tracker_by_hand():
    """4 m away along Y: 2 um and 1 um/m along the beam, 10 um and 3 um/m across it."""
    tracker = LaserTracker(u_range_um=2.0, u_range_um_per_m=1.0, u_angle_um=10.0, u_angle_um_per_m=3.0)
    (found,) = tracker.covariance(np.array([[0.0, 4000.0, 0.0]]))
    np.testing.assert_allclose(found * 1e6, np.diag([22.0, 6.0, 22.0]) ** 2, atol=1e-9)
    assert LaserTracker.typical() == LaserTracker(0.0, 0.25, 10.0, 2.5)  # virtual calibration paper, table 3
