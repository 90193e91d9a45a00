"""Several files as one measurement."""

import io
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from support.virtual_measurements import ONE, THREE, measured, positions, truth

import machines
from calibration.fit.calibrate import calibrate
from calibration.instruments import LaserTracker
from calibration.measurement.file import read_measurement
from calibration.measurement.joining import joined
from calibration.measurement.measurement import Measurement, Target
from calibration.measurement.readers import read_any
from calibration.measurement.written_file import write_measurement
from kinematics.effects import GrowthWithTime
from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError

GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")
TRACKED = "# machine: gantry\n# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 2\n# target.t: 0 0 -50\n"
LASER = "# machine: gantry\n# instrument: interferometer\n# u_um: 1\n"


@pytest.fixture
def read(tmp_path):
    """Reads texts as files of these names, and joins them."""

    def read_texts(machine=GANTRY, **texts: str) -> list[Measurement]:
        for name, text in texts.items():
            (tmp_path / f"{name}.csv").write_text(text)
        return [read_measurement(tmp_path / f"{name}.csv", machine) for name in texts]

    return read_texts


def test_columns_follow_one_another(read):
    one, two = read(
        a=TRACKED + "X,Y,Z,time_s,station,run,temp_s,x,y,z\n0,0,0,0,S,r,20,1,2,3\n5,0,0,10,S,q,21,6,2,3\n",
        b=TRACKED + "X,Y,Z,time_s,station,run,temp_s,x,y,z\n7,0,0,20,S,r,22,1,2,4\n9,0,0,30,T,r,23,6,2,4\n",
    )
    m = joined([one, two])
    assert m.state.positions[:, 0].tolist() == [0, 5, 7, 9]
    assert m.state.time.tolist() == [0, 10, 20, 30]
    assert m.state.station.tolist() == ["a.csv:S", "a.csv:S", "b.csv:S", "b.csv:T"]
    assert m.run.tolist() == ["a.csv:r", "a.csv:q", "b.csv:r", "b.csv:r"]
    assert m.state.temperatures["s"].tolist() == [0, 1, 2, 3]
    assert m.state.approach[:, 0].tolist() == [0, 1, 0, 1]
    assert m.observed[:, 2].tolist() == [3, 3, 4, 4]
    assert [m.where(row) for row in (1, 2)] == ["a.csv:8", "b.csv:7"]
    assert m.rows(np.array([3])).where(0) == "b.csv:8"
    assert m.source == "a.csv + b.csv"
    assert m.fingerprint not in (one.fingerprint, two.fingerprint, "")
    assert len(m.notes) == 0
    assert joined([one]) is one


def test_stations_and_runs_without_names_are_set_ups_of_their_own(read):
    text = TRACKED + "X,Y,Z,x,y,z\n0,0,0,1,2,{}\n5,0,0,6,2,3\n"
    m = joined(read(a=text.format(1), b=text.format(2)))
    assert m.groups.tolist() == ["a.csv:1", "a.csv:1", "b.csv:1", "b.csv:1"]
    assert m.run.tolist() == ["a.csv:1", "a.csv:1", "b.csv:1", "b.csv:1"]


def test_files_of_one_name_in_two_folders(read):
    one, two = read(a=TRACKED + "X,Y,Z,x,y,z\n0,0,0,1,2,3\n", b=TRACKED + "X,Y,Z,x,y,z\n0,0,0,1,2,4\n")
    m = joined([replace(one, source="u/m.csv"), replace(two, source="v/m.csv")])
    assert m.groups.tolist() == ["u/m.csv:1", "v/m.csv:1"]


def test_time_that_begins_anew_is_shifted(read):
    text = TRACKED + "X,Y,Z,time_s,x,y,z\n0,0,0,{},1,2,3\n5,0,0,{},6,2,3\n"
    m = joined(read(a=text.format(0, 60), b=text.format(10, 30), c=text.format(500, 600)))
    assert m.state.time.tolist() == [0, 60, 60, 80, 500, 600]
    assert m.notes == ("b.csv: its time begins anew, and is shifted by 50 s to follow the file before",)


def test_what_one_file_does_not_say_is_dropped_with_a_note(read):
    m = joined(
        read(
            a=TRACKED + "X,Y,Z,time_s,feed,temp_s,run,actual_X,x,y,z\n0,0,0,0,0,20,1,0.1,1,2,3\n",
            b=TRACKED + "X,Y,Z,temp_t,x,y,z\n0,0,0,20,1,2,4\n",
        )
    )
    assert m.state.time is None
    assert m.state.temperatures == {}
    assert m.feed is None
    assert m.state.velocity is None
    assert m.state.cycle is None
    np.testing.assert_array_equal(m.actual[:, 0], [0.1, np.nan])
    assert sorted(m.notes) == [
        "no read-back in b.csv",
        "run as a cycle is unknown in b.csv: it is not used in the other files either",
        "the feed is unknown in b.csv: it is not used in the other files either",
        "the temperature s is unknown in b.csv: it is not used in the other files either",
        "the temperature t is unknown in a.csv: it is not used in the other files either",
        "the time is unknown in b.csv: it is not used in the other files either",
    ]


def test_interferometer_runs_keep_zeros_of_their_own(read):
    text = LASER + "axis,run,direction,target_mm,deviation_um\nX,1,+,0,{}\nX,1,+,10,1\n"
    m = joined(read(a=text.format(0), b=text.format(2)))
    assert m.groups.tolist() == ["X a.csv:1", "X a.csv:1", "X b.csv:1", "X b.csv:1"]
    assert m.state.station is None


MOVING = "X,Y,Z,feed,x,y,z\n0,0,0,60,1,2,3\n1,0,0,60,2,2,3\n"
STANDING = "X,Y,Z,x,y,z\n0,0,0,1,2,3\n"


@pytest.mark.parametrize(
    ("one", "two", "words"),
    [
        (TRACKED + STANDING, TRACKED.replace("um: 2", "um: 3") + STANDING, "differ in the instrument or its uncertainties"),
        (TRACKED + STANDING, LASER + "axis,run,direction,target_mm,deviation_um\nX,1,+,0,1\n", "differ in the instrument"),
        (TRACKED + STANDING, TRACKED + "# stands_on: bed\n" + STANDING, "differ in stands_on"),
        (TRACKED + STANDING, TRACKED.replace("-50", "-60") + STANDING, "target t is at 0 0 -60 on the tool, in another file at 0 0 -50"),
        (TRACKED + STANDING, TRACKED + STANDING, "contain the same data"),
        (TRACKED + MOVING, TRACKED + STANDING, "b.csv: no column feed, while other files have rows in motion"),
    ],
)  # fmt: skip
def test_refused(read, one, two, words):
    measurements = read(a=one, b=two)
    with pytest.raises(UserError) as fault:
        joined(measurements)
    assert words in str(fault.value)


def test_other_machines_and_nothing_are_refused(read):
    (one,) = read(a=TRACKED + STANDING)
    (two,) = read(DMU50, b=TRACKED.replace("gantry", "dmu50") + STANDING)
    with pytest.raises(UserError, match="differ in the machine"):
        joined([one, two])
    with pytest.raises(UserError, match="no measurement"):
        joined([])


def test_targets_of_all_files(read):
    two = TRACKED.replace("target.t: 0 0 -50", "target.u: 0 0 -90") + STANDING
    m = joined(read(a=TRACKED + STANDING, b=two))
    assert m.targets == {"t": Target((0.0, 0.0, -50.0)), "u": Target((0.0, 0.0, -90.0))}
    assert m.tool[:, 2].tolist() == [-50, -90]


def test_written_and_read_it_is_the_same(tmp_path):
    rng = np.random.default_rng(1)
    two = [measured(GANTRY, positions(GANTRY, 20, rng), THREE, truth(GANTRY, rng), rng) for _ in range(2)]
    m = joined([replace(part, source=name, fingerprint=name) for part, name in zip(two, "ab", strict=True)])
    text = io.BytesIO()
    write_measurement(m, text)
    (tmp_path / "m.csv").write_bytes(text.getvalue())
    again = read_measurement(tmp_path / "m.csv", GANTRY)
    np.testing.assert_array_equal(again.observed, m.observed)
    assert again.groups.tolist() == m.groups.tolist()
    assert again.run.tolist() == m.run.tolist()
    np.testing.assert_array_equal(again.state.approach, m.state.approach)


def test_real_plates_are_set_ups_of_their_own(plates):
    files = sorted(path for path in plates.rglob("*") if path.is_file())
    header = {"u_um": "2.3", "part_offset": "350 350 100"}
    parts = [read_any(path, machines.load("cframe"), "cmm", header=header) for path in files]
    m = joined(parts)
    assert len(m) == sum(map(len, parts))
    assert sorted(set(m.groups)) == sorted(f"{path.name}:1" for path in files)
    found = calibrate(m, basis="legendre:3", variance="estimate", hold_out=False)
    assert found.fit.rms_um < found.before_rms_um < 10.0


def test_growth_is_seen_from_two_runs_hours_apart():
    """Each run sees an hour of growth; both together, ten hours."""
    rng, growing = np.random.default_rng(4), GrowthWithTime(axis="X", rate=5.0)
    model = msgspec.structs.replace(no_errors(GANTRY), effects=(growing,))
    tracker = LaserTracker(u_range_um=0.5, u_angle_um=2.0)
    parts = []
    for name, start in (("cold", 0.0), ("warm", 36000.0)):
        m = measured(GANTRY, positions(GANTRY, 240, rng), ONE, model, rng, tracker=tracker, start_s=start)
        parts.append(replace(m, source=name, fingerprint=name))

    def growth(measurement):
        start = GrowthWithTime(axis="X", rate=0.0)
        found = calibrate(measurement, basis="legendre:1", effects=[start], hold_out=False)
        return next(e for e in found.model.effects if isinstance(e, GrowthWithTime))

    both, alone = growth(joined(parts)), growth(parts[0])
    assert abs(both.rate - 5.0) < 4 * both.uncertainties[0]
    assert both.uncertainties[0] < 0.3 * alone.uncertainties[0]
