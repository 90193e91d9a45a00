"""Rows in motion: their velocities, and the effects that act through them."""

import io
import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from virtual_machine import draws

import machines
from calibration.fit.calibrate import calibrate
from calibration.instruments import Interferometer, LaserTracker
from calibration.measurement.file import read_measurement
from calibration.measurement.written_file import write_measurement
from calibration.simulation.simulate import observe, tracker_pose
from kinematics.effects import FollowingError, LateReadBack
from kinematics.error_model.model import no_errors
from kinematics.state import State
from kinematics.user_error import UserError

GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")
HEAD = "# machine: {}\n# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\n"


@pytest.fixture
def read(tmp_path):
    def read_text(text: str, machine=GANTRY):
        path = tmp_path / "m.csv"
        path.write_text(HEAD.format(machine.name) + text)
        return read_measurement(path, machine)

    return read_text


def velocity(measurement):
    assert measurement.state.velocity is not None
    return (measurement.state.velocity + 0.0).tolist()


def test_without_feed_nothing_is_known_of_it(read):
    assert read("X,Y,Z,x,y,z\n0,0,0,0,0,0\n1,0,0,1,0,0\n").state.velocity is None


def test_speed_is_that_of_the_linear_axes_together(read):
    """A step of (3, 4) mm at 600 mm/min: 10 mm/s along (0.6, 0.8)."""
    m = read("X,Y,Z,feed,x,y,z\n0,0,0,0,0,0,0\n3,4,0,600,0,0,0\n6,8,0,600,0,0,0\n6,8,0,0,0,0,0\n")
    assert velocity(m) == [[0, 0, 0], [6, 8, 0], [6, 8, 0], [0, 0, 0]]


def test_first_in_motion_goes_to_the_next(read):
    """Neither a jump before the run, nor the end of the run before, says which way."""
    m = read(
        "X,Y,Z,run,feed,x,y,z\n9,0,0,a,0,0,0,0\n0,0,0,a,60,0,0,0\n1,0,0,a,60,0,0,0\n0,5,0,b,120,0,0,0\n0,3,0,b,120,0,0,0\n"
    )
    assert velocity(m) == [[0, 0, 0], [1, 0, 0], [1, 0, 0], [0, -2, 0], [0, -2, 0]]


def test_rotary_axes_share_the_time_of_the_linear_ones(read):
    """C turns 90 degrees while X goes 10 mm at 60 mm/min, in 10 s; alone it turns at deg/min."""
    m = read("C,X,feed,x,y,z\n0,0,60,0,0,0\n90,10,60,0,0,0\n180,10,120,0,0,0\n", DMU50)
    c, x = DMU50.index("C"), DMU50.index("X")
    np.testing.assert_allclose(m.state.velocity[1, [c, x]], [math.radians(9.0), 1.0], rtol=1e-15)
    np.testing.assert_allclose(m.state.velocity[2, [c, x]], [math.radians(2.0), 0.0], rtol=1e-15)


def test_direction_of_an_interferometer_decides(tmp_path):
    """A way back that begins beyond the last target of the way there goes back all the same."""
    path = tmp_path / "m.csv"
    path.write_text(
        "# machine: gantry\n# instrument: interferometer\n# u_um: 1\naxis,run,direction,target_mm,deviation_um,feed\n"
        "X,1,+,0,0,60\nX,1,+,10,0,60\nX,1,-,12,0,60\nX,1,-,2,0,60\nY,1,+,7,0,60\nY,1,+,9,0,60\nZ,1,-,5,0,60\n"
    )
    m = read_measurement(path, GANTRY)
    along = np.array(velocity(m))
    assert along[:4, GANTRY.index("X")].tolist() == [1, 1, -1, -1]
    assert along[4:6, GANTRY.index("Y")].tolist() == [1, 1]
    assert np.count_nonzero(along) == 6
    assert m.notes[-1] == "line 11: the row has a feed, but no axis moves: it is read as a standstill"


def test_negative_feed_is_refused(read):
    with pytest.raises(UserError, match=r"m\.csv:7 column feed: is below 0"):
        read("X,Y,Z,feed,x,y,z\n0,0,0,0,0,0,0\n3,4,0,-600,0,0,0\n")


def _to_and_fro(measurement, feed, tmp_path):
    """The measurement with its feed, through a file."""
    text = io.BytesIO()
    write_measurement(replace(measurement, feed=feed, source="m"), text)
    (tmp_path / "m.csv").write_bytes(text.getvalue())
    return read_measurement(tmp_path / "m.csv", measurement.machine)


def test_lag_of_an_axis_is_found(tmp_path):
    """Two feeds there and back along X, from file to fit: 2 ms of lag at 50 and 100 mm/s."""
    there = np.linspace(0.0, 2000.0, 41)
    x = np.concatenate([there, there[::-1], there, there[::-1]])
    feed = np.repeat([3000.0, 6000.0], 82)
    way = np.repeat([1.0, -1.0, 1.0, -1.0], 41)
    positions, speed = np.zeros((164, 3)), np.zeros((164, 3))
    positions[:, GANTRY.index("X")], speed[:, GANTRY.index("X")] = x, way * feed / 60.0
    approach = np.zeros((164, 3))
    approach[:, GANTRY.index("X")] = way
    model = msgspec.structs.replace(no_errors(GANTRY), effects=(FollowingError("X", lag_ms=2.0),))
    names = np.repeat(["1", "2"], 82)
    m = observe(
        GANTRY, model, State(positions, approach=approach, velocity=speed, cycle=np.repeat([0.0, 1.0], 82)),
        Interferometer(u_um=0.5), np.random.default_rng(1), axis=np.full(164, "X"), run=names,
    )  # fmt: skip
    m = _to_and_fro(m, feed, tmp_path)
    np.testing.assert_allclose(m.state.velocity, speed, rtol=1e-12)
    found = calibrate(m, basis="legendre:3", effects=[FollowingError("X", lag_ms=0.0)], hold_out=False).model
    lag = next(e for e in found.effects if isinstance(e, FollowingError))
    assert abs(lag.lag_ms - 2.0) < 4 * lag.uncertainties[0]
    assert lag.uncertainties[0] < 0.01


def test_late_read_back_is_found(tmp_path):
    """A tracker whose clock is 1.5 ms off, on moves of all axes."""
    rng = np.random.default_rng(2)
    positions = np.repeat(rng.uniform(0, 800, (60, 3)), 2, axis=0)
    step = rng.normal(0.0, 20.0, (60, 3))
    positions[1::2] += step
    feed = 9000.0
    speed = np.repeat(step / np.linalg.norm(step, axis=1, keepdims=True) * feed / 60.0, 2, axis=0)
    model = msgspec.structs.replace(no_errors(GANTRY), effects=(LateReadBack(lag_ms=1.5),))
    state = State(positions, velocity=speed, cycle=np.repeat(np.arange(60.0), 2))
    tracker = LaserTracker(u_range_um=2.0, u_angle_um=4.0)
    m = observe(GANTRY, model, state, tracker, rng, {"1": tracker_pose((-1500, 500, 0), rng)})
    m = replace(m, run=np.repeat(np.arange(60), 2).astype(str))
    m = _to_and_fro(m, np.full(120, feed), tmp_path)
    np.testing.assert_allclose(m.state.velocity, speed, rtol=1e-9)
    found = calibrate(m, basis="legendre:1", effects=[LateReadBack(lag_ms=0.0)], hold_out=False).model
    late = next(e for e in found.effects if isinstance(e, LateReadBack))
    assert abs(late.lag_ms - 1.5) < 4 * late.uncertainties[0]
    assert late.uncertainties[0] < 0.02


@pytest.mark.parametrize("name", draws.MACHINES)
def test_lag_of_the_virtual_machine_is_found(tmp_path, name):
    """Moves of another make: velocities from the file alone give the lag that was put in."""
    question = draws.draw(["following-error"], name, 1)
    (tmp_path / "m.csv").write_text(question.sheet())
    measurement = read_measurement(tmp_path / "m.csv", machines.load(name))
    (cause,) = question.causes
    start = FollowingError(cause.axis, lag_ms=0.0)
    found = calibrate(measurement, basis="legendre:5", effects=[start], hold_out=False).model
    lag = next(e for e in found.effects if isinstance(e, FollowingError))
    assert abs(lag.lag_ms - cause.lag_ms) < 4 * lag.uncertainties[0]
    assert lag.uncertainties[0] < 0.1 * cause.lag_ms
