"""Effects of the instrument against disturbing what it reads."""

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.effect_examples import DMU50

import machines
from kinematics.deviation import exact_deviation
from kinematics.effects import (
    AirDrift,
    AirScale,
    AngleHarmonic,
    AngleStep,
    Effect,
    MeasuringMachineScale,
    MeasuringMachineSquareness,
    Outliers,
    ProbeLobing,
    RangeDrift,
    RangeOffset,
    StationShift,
    TargetOffset,
    TrackerDrift,
)
from kinematics.error_model.model import no_errors
from kinematics.forward import tool_point
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

POINTS = np.random.default_rng(5).uniform(-3000.0, 3000.0, (40, 3))
SECOND_ORDER = 4e-6
"""mm: 28 urad twice, at 5 m."""


def seen(effect: Effect, **columns: Array) -> Array:
    """What it adds to the observed points `(n, 3)`, mm."""
    state = State(np.zeros((len(POINTS), 5)), observed=POINTS, **columns)
    model = msgspec.structs.replace(no_errors(DMU50), effects=(effect,))
    errors, shift = model.observation(DMU50, state)
    assert not errors.any()
    return shift


def read(points: Array) -> tuple[Array, Array, Array]:
    """Range, azimuth and elevation."""
    x, y, z = points.T
    return np.linalg.norm(points, axis=1), np.arctan2(y, x), np.arcsin(z / np.linalg.norm(points, axis=1))


def placed(length: Array, azimuth: Array, elevation: Array) -> Array:
    flat = length * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), length * np.sin(elevation)], axis=1)


def from_moved_station(shift_um: Array, turn_urad: Array) -> Array:
    """The points as a station sees them that stands shifted and turned in the frame they are given in."""
    return Rotation.from_rotvec(np.array(turn_urad) * 1e-6).inv().apply(POINTS - np.array(shift_um) * 1e-3)


def test_a_station_that_stands_elsewhere_sees_all_points_moved_the_other_way():
    station = np.where(np.arange(len(POINTS)) % 3 == 0, "s2", "s1")
    shift, turned = (30.0, -20.0, 10.0), (15.0, -12.0, 20.0)
    found = seen(StationShift("s2", shift, turned), station=station)
    expected = np.where((station == "s2")[:, None], from_moved_station(shift, turned) - POINTS, 0.0)
    assert found == pytest.approx(expected, abs=SECOND_ORDER)
    assert np.abs(found).max() > 0.05


def test_a_drifting_tracker_is_a_station_that_moves():
    shift, turned = np.array([30.0, -20.0, 10.0]), np.array([15.0, -12.0, 20.0])
    for hours in (0.0, 1.0, 0.25):
        time = np.full(len(POINTS), hours * 3600.0)
        found = seen(TrackerDrift(tuple(shift), tuple(turned)), time=time)
        assert found == pytest.approx(from_moved_station(hours * shift, hours * turned) - POINTS, abs=SECOND_ORDER)


def test_a_range_offset_and_the_air_make_ranges_too_long():
    length, *angles = read(POINTS)
    assert seen(RangeOffset(12.0)) == pytest.approx(placed(length + 12e-3, *angles) - POINTS, abs=1e-9)
    assert seen(AirScale(3.0)) == pytest.approx(placed(length * (1 + 3e-6), *angles) - POINTS, abs=1e-9)


@pytest.mark.parametrize("harmonic", [1, 2, 5])
def test_an_encoder_reads_too_much(harmonic):
    length, azimuth, elevation = read(POINTS)
    too_much = [1e-6 * (9 * np.sin(harmonic * a) - 4 * np.cos(harmonic * a)) for a in (azimuth, elevation)]
    found = seen(AngleHarmonic("azimuth", harmonic, 9.0, -4.0))
    assert found == pytest.approx(placed(length, azimuth + too_much[0], elevation) - POINTS, abs=SECOND_ORDER)
    found = seen(AngleHarmonic("elevation", harmonic, 9.0, -4.0))
    assert found == pytest.approx(placed(length, azimuth, elevation + too_much[1]) - POINTS, abs=SECOND_ORDER)


@pytest.mark.parametrize("above", [-170.0, 20.0, 160.0])
def test_an_encoder_that_loses_counts_reads_too_much_within_half_a_turn(above):
    length, azimuth, elevation = read(POINTS)
    beyond = np.angle(np.exp(1j * (azimuth - np.radians(above)))) >= 0.0
    assert 0 < np.count_nonzero(beyond) < len(POINTS)
    found = seen(AngleStep("elevation", "azimuth", above, 9.0))
    assert found == pytest.approx(placed(length, azimuth, elevation + 9e-6 * beyond) - POINTS, abs=SECOND_ORDER)
    above = float(np.degrees(np.median(elevation)))
    found = seen(AngleStep("azimuth", "elevation", above, -7.0))
    beyond = elevation >= np.median(elevation)
    assert found == pytest.approx(placed(length, azimuth - 7e-6 * beyond, elevation) - POINTS, abs=SECOND_ORDER)


def test_a_target_that_sits_elsewhere_is_a_longer_tool():
    rng, tool, offset = np.random.default_rng(3), np.array([20.0, -30.0, -150.0]), (40.0, -25.0, 60.0)
    q = rng.uniform(*DMU50.travel, (20, 5))
    target = np.where(np.arange(20) < 12, "t1", "t2")
    model = msgspec.structs.replace(no_errors(DMU50), effects=(TargetOffset("t1", offset),))
    errors, _ = model.observation(DMU50, State(q, target=target))
    expected = tool_point(DMU50, q, tool + np.where((target == "t1")[:, None], np.array(offset) * 1e-3, 0.0))
    assert tool_point(DMU50, q, tool, errors) == pytest.approx(expected, abs=1e-10)


def test_outliers_are_rows():
    found = seen(Outliers((7, 2), (100.0, 0.0, -50.0, 1.0, 2.0, 3.0)))
    expected = np.zeros((40, 3))
    expected[7], expected[2] = (0.1, 0.0, -0.05), (1e-3, 2e-3, 3e-3)
    assert found == pytest.approx(expected, abs=1e-15)
    with pytest.raises(UserError, match=r"^outliers: there is no row 40 in 40 rows$"):
        seen(Outliers((40,), (1.0, 1.0, 1.0)))


def test_range_and_air_drift_from_zero():
    time = np.linspace(0.0, 7200.0, len(POINTS))
    length, *angles = read(POINTS)
    hours = time / 3600.0
    assert seen(RangeDrift(12.0), time=time) == pytest.approx(
        placed(length + 12e-3 * hours, *angles) - POINTS, abs=1e-9
    )
    expected = placed(length * (1 + 3e-6 * hours), *angles) - POINTS
    assert seen(AirDrift(3.0), time=time) == pytest.approx(expected, abs=1e-9)


def test_a_measuring_machine_reads_a_square_part_askew():
    """A machine whose y axis leans by 8 urad to x, away from it, and whose z scale is 5 um/m short of a metre."""
    angle, scale = 8e-6, 5e-6
    leaning = np.column_stack([[1, 0, 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1 / (1 + scale)]])
    told = np.linalg.solve(leaning, POINTS.T).T
    found = seen(MeasuringMachineSquareness("xy", 8.0)) + seen(MeasuringMachineScale("z", 5.0))
    assert found == pytest.approx(told - POINTS, abs=1e-6)


def test_a_knock_and_a_new_seat_begin_at_their_moment():
    time = np.arange(len(POINTS)) * 10.0
    station = np.full(len(POINTS), "s1")
    late = seen(StationShift("s1", (30.0, -20.0, 10.0), since_s=200.0), station=station, time=time)
    always = seen(StationShift("s1", (30.0, -20.0, 10.0)), station=station)
    assert late == pytest.approx(np.where((time >= 200.0)[:, None], always, 0.0))
    state = State(np.zeros((40, 5)), target=np.full(40, "t1"), time=time)
    model = msgspec.structs.replace(no_errors(DMU50), effects=(TargetOffset("t1", (40.0, -25.0, 60.0), 200.0),))
    moved = model.observation(DMU50, state).errors[:, -1, :3]
    assert moved == pytest.approx(np.where((time >= 200.0)[:, None], (40e-3, -25e-3, 60e-3), 0.0))


HEAD = machines.load("head_head")


def touched_off(angle_deg: float, cosine_um: float, sine_um: float) -> Array:
    """Where the centre of a sphere is found, mm from where it is, in x and y of the bed: by four touches.

    The probe is vertical, and turned by the angle; each touch goes on by the pre-travel in its direction.
    """
    found = []
    for along in (0.0, 90.0):
        both = []
        for touch in (along, along + 180.0):
            a = np.radians(touch - angle_deg)
            travel = cosine_um * np.cos(3.0 * a) + sine_um * np.sin(3.0 * a)
            both.append(travel * 1e-3 * np.array([np.cos(np.radians(touch)), np.sin(np.radians(touch))]))
        found.append((both[0] + both[1]) / 2.0)
    return np.asarray(found[0] + found[1])


def test_lobes_of_a_probe_move_the_centre_that_four_touches_find():
    """Each pair of opposite touches finds one coordinate; the tip is off from the true centre by that much."""
    angles = np.arange(0.0, 360.0, 17.0)
    positions = np.zeros((len(angles), len(HEAD.axes)))
    positions[:, HEAD.index("C")] = np.radians(angles)
    effect = ProbeLobing(cosine_um=2.0, sine_um=-0.7)
    model = msgspec.structs.replace(no_errors(HEAD), effects=(effect,))
    errors, shift = model.observation(HEAD, State(positions))
    assert not shift.any()
    moved = exact_deviation(HEAD, positions, errors, (0.0, 0.0, 0.0)).position
    expected = [touched_off(angle, 2.0, -0.7) for angle in angles]
    np.testing.assert_allclose(-moved[:, :2], expected, atol=1e-9)
    np.testing.assert_allclose(moved[:, 2], 0.0, atol=1e-12)
