"""Continuous runs fused with quasi-static readings: the paper's case, oracles of each step, and a real axis."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.continuous_cases import LENGTH, TRAVEL, paper_case, virtual_case

import machines
from calibration.continuous.clock import clocked, raster
from calibration.continuous.error_curve import course_of
from calibration.continuous.estimate import estimate
from calibration.continuous.features import features
from calibration.continuous.noise import Noise, noise_of_course
from calibration.continuous.records import QuasiStatic, Record
from calibration.continuous.segment import constant_velocity
from calibration.continuous.shape import Extra, shape_of
from calibration.continuous.virtual import Laser, Motion, Targets, _profile
from calibration.measurement.readers import read_any
from kinematics.user_error import UserError

WHITE = Noise(np.ones(1), 0.1, 0.1, 2e-4, ())


def rms(values):
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def straight(n=400, speed=10.0, noise=0.1, seed=0, error=lambda x: 0.0 * x, rate=100.0):
    """A record in motion from beginning to end, whose displacement is its position."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) / rate
    x = speed * time
    shown = x + 1e-3 * (error(x) + noise * rng.standard_normal(n))
    return Record("1 forward", 1, time, shown, 0.0, float(x[-1]), speed * 60.0, "straight")


def readings(targets, values, u=0.1, direction=1, run="1"):
    ones = np.full(len(targets), direction)
    return QuasiStatic(
        np.array(targets, float), np.array(values, float), ones, np.full(len(targets), run), u, source="t"
    )


# ---- the paper's synthetic case


@lru_cache(8)
def estimated(seed, noise=0.15, noise_quasi=0.15, positions=None):
    """The estimate of a draw, at positions (a tuple), which several tests look at."""
    case = paper_case(seed, noise, noise_quasi)
    return estimate([case.record], case.quasi, positions=None if positions is None else np.array(positions))


def scored(seeds, noise=0.15, noise_quasi=0.15):
    """RMS of the three methods and ours, and coverage, per draw."""
    rows = []
    for seed in seeds:
        case, found = paper_case(seed, noise, noise_quasi), estimated(seed, noise, noise_quasi)
        (compared,) = found.comparisons.values()
        table = found.table()
        inner = table.continuous
        off = table.error[inner] - case.truth(table.position[inner])
        methods = [rms(errors - case.truth(compared.x)) for errors in compared.errors.values()]
        rows.append([*methods, rms(off), np.mean(np.abs(off) < 2 * table.u[inner])])
    return np.mean(rows, axis=0)


def two_points_alone(seeds, noise, noise_quasi):
    """RMS of samples whose slope is that of two readings, 100 mm within the ends; without the code under test."""
    x = np.linspace(7.0, LENGTH - 6.0, 1000)  # that far the run is at constant velocity
    found = []
    for seed in seeds:
        case = paper_case(seed, noise, noise_quasi)
        slope, _ = np.polyfit(x, case.truth(x), 1)
        wrong = (case.quasi.deviation[-2] - case.quasi.deviation[1]) / (LENGTH - 200.0) - slope
        found.append(np.hypot(wrong * np.std(x), noise))
    return np.mean(found)


def test_joint_estimate_is_below_the_papers_methods():
    end, two, least, ours, _ = scored(range(2))
    assert ours < 0.14
    assert ours < least < two < end


@pytest.mark.statistical
@pytest.mark.parametrize("noise_quasi", [0.05, 0.15])
def test_the_papers_case_over_300_draws(noise_quasi):
    noise = 0.15 if noise_quasi == 0.15 else 0.1
    end, two, least, ours, coverage = scored(range(300), noise, noise_quasi)
    assert 2.3 < end < 2.8
    assert two == pytest.approx(two_points_alone(range(300), noise, noise_quasi), rel=0.02)
    assert two < 0.65
    assert ours < 0.5 * least
    assert ours < 0.14
    assert 0.92 < coverage < 0.98


def test_ends_of_the_travel_are_the_readings():
    case, table = paper_case(1), estimated(1).table()
    outside = ~table.continuous
    assert table.position[outside].tolist() == [0.0, LENGTH]
    assert table.error[outside] == pytest.approx(case.quasi.deviation[[0, -1]], abs=1e-6)
    assert np.all(table.u[outside] >= 0.15)
    assert np.all(np.diff(table.position) > 0)


@pytest.mark.parametrize("more", [-50.0, 20.0])
def test_readings_outside_the_segment_do_not_move_the_table(more):
    case = paper_case(2)
    moved = case.quasi.deviation.copy()
    moved[-1] += more
    quasi = replace(case.quasi, deviation=moved)
    at = np.linspace(50.0, 950.0, 19)
    before = estimated(2, positions=tuple(at))
    after = estimate([case.record], quasi, positions=at)
    # the last reading also says where the axis rests: positions follow it, as far as the error changes there
    assert after.fused.values == pytest.approx(before.fused.values, abs=0.02)


def test_more_readings_mean_less_uncertainty():
    u = []
    for spacing in (200.0, 100.0, 25.0):
        case = paper_case(0, spacing=spacing)
        u.append(rms(estimate([case.record], case.quasi, positions=np.linspace(50.0, 950.0, 10)).table().u[1:-1]))
    assert u[0] > u[1] > u[2]


def test_uncertainty_is_largest_far_from_the_middle():
    table = estimated(0).table()
    inner = table.u[table.continuous]
    assert inner[0] > 1.3 * inner[len(inner) // 2] < inner[-1]


def test_scale_of_the_instrument_is_in_the_uncertainty():
    case = paper_case(0)
    plain = estimated(0).table()
    scaled = estimate([case.record], replace(case.quasi, u_per_m=3.0)).table()
    assert scaled.u**2 - plain.u**2 == pytest.approx((3.0e-3 * plain.position) ** 2, abs=1e-9)


def test_noise_beyond_the_specification_widens_the_table():
    case = paper_case(0, noise_quasi=1.5)
    honest = estimate([case.record], replace(case.quasi, u=0.15))
    assert honest.fused.spread.noise > 0.8
    assert any("the instrument specification gives 0.15 um" in note for note in honest.notes)


# ---- segment


@given(
    feed=st.sampled_from([500.0, 2000.0, 10_000.0]),
    acceleration=st.floats(500.0, 5000.0),
    jerk=st.floats(2e4, 5e5),
    lag=st.floats(0.0, 0.03),
    seed=st.integers(0, 1000),
)
@settings(max_examples=15)
def test_nothing_of_the_ramps_is_left_in_the_segment(feed, acceleration, jerk, lag, seed):
    motion = Motion(0.0, 450.0, feed, acceleration, jerk, lag)
    profile = _profile(motion, 1000.0)
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(profile.time))
    record = Record("1 forward", 1, profile.time, profile.along + noise, 0.0, 450.0, feed, "ramp")
    found = constant_velocity(record)
    rows = slice(found.first, found.stop)
    time, place = profile.time[rows], profile.along[rows]
    level = place - np.polyval(np.polyfit(time - time.mean(), place, 1), time - time.mean())
    assert np.abs(level).max() < 2e-4
    assert place[-1] - place[0] > 0.5 * 450.0


def test_settling_vibration_is_left_out():
    calm = virtual_case(0, feed=5000.0)
    shaken = virtual_case(0, feed=5000.0, laser=Laser(1000.0, settling=(18.0, 20.0, 0.15)))
    first = [constant_velocity(case.measured.records[0]).first for case in (calm, shaken)]
    assert first[1] > first[0] + 150
    at = np.linspace(60.0, 430.0, 38)
    found = estimate(shaken.measured.records, shaken.quasi, positions=at)
    assert rms(found.fused.values[0] - shaken.truth(at, 1)) < 0.25


def test_a_pause_on_the_way_leaves_the_longer_stretch():
    case = paper_case(0)
    record = case.record
    half = len(record) // 3
    time = np.concatenate([record.time[:half], record.time[half] + np.arange(500) / 100.0, record.time[half:] + 5.0])
    shown = np.concatenate(
        [record.displacement[:half], np.full(500, record.displacement[half]), record.displacement[half:]]
    )
    found = constant_velocity(replace(record, time=time, displacement=shown))
    assert found.first > half + 490
    assert any("feed changes" in note for note in found.notes)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda r: replace(r, displacement=-r.displacement), "reverse its sign"),
        (lambda r: replace(r, displacement=0.0 * r.displacement), "the axis did not move"),
        (
            lambda r: replace(r, displacement=np.minimum(r.displacement, 600.0 - 0.5 * r.displacement)),
            "forward and backward",
        ),
        (lambda r: replace(r, time=r.time[:90], displacement=r.displacement[:90]), "90 samples"),
        (lambda r: replace(r, displacement=r.displacement / 25.4), "from standstill to standstill"),
        (lambda r: replace(r, end=900.0), "from standstill to standstill"),
    ],
)
def test_records_that_can_not_be_used(change, says):
    case = paper_case(0)
    with pytest.raises(UserError, match=says):
        estimate([change(case.record)], case.quasi)


def test_a_record_without_rest_needs_its_place():
    record = straight(2000)
    quasi = readings([10.0, 100.0, 180.0], [0.0, 0.0, 0.0])
    found = estimate([record], quasi)
    assert any("used as the position" in note for note in found.notes)
    with pytest.raises(UserError, match="has no standstill"):
        estimate([replace(record, displacement=record.displacement + 5.0)], quasi)


# ---- clock, spikes, losses


@given(jitter=st.floats(0.0, 0.2), lost=st.floats(0.0, 0.05), seed=st.integers(0, 1000))
@settings(max_examples=15)
def test_an_even_clock_behind_stamps_that_scatter(jitter, lost, seed):
    rng = np.random.default_rng(seed)
    kept = np.flatnonzero(rng.random(3000) >= lost)
    stamps = 1e-3 * (kept + jitter * np.clip(rng.standard_normal(len(kept)), -2.0, 2.0))
    slots, period = raster(np.sort(stamps))
    assert period == pytest.approx(1e-3, rel=2e-4)
    assert np.mean(slots - slots[0] != kept - kept[0]) < 0.02


def test_scattering_stamps_are_replaced_and_told():
    record = straight(3000, speed=80.0, noise=0.1, rate=1000.0)
    rng = np.random.default_rng(0)
    late = replace(record, time=np.sort(record.time + 2e-4 * rng.standard_normal(3000)))
    found, notes = clocked(late)
    assert np.abs(found.time - record.time).max() < 2e-5
    assert "scatter by" in notes[0]
    assert clocked(record) == (record, [])


def test_spikes_and_lost_samples_do_no_harm():
    case = paper_case(3)
    rng = np.random.default_rng(0)
    shown = case.record.displacement.copy()
    shown[rng.integers(1000, 11_000, 20)] += 0.02
    kept = rng.random(len(shown)) > 0.1
    spoilt = replace(case.record, time=case.record.time[kept], displacement=shown[kept])
    at = np.linspace(20.0, 980.0, 97)
    found = estimate([spoilt], case.quasi, positions=at)
    whole = estimate([case.record], case.quasi, positions=at)
    assert 10 <= found.by_direction[1].courses[0].dropped <= 30
    assert abs(found.by_direction[1].courses[0].missing - np.count_nonzero(~kept)) < 100
    assert found.fused.values == pytest.approx(whole.fused.values, abs=0.08)


# ---- features and noise


def test_cyclic_error_within_its_uncertainty():
    case = virtual_case(1)
    (wave,) = estimate(case.measured.records, case.quasi).by_direction[1].waves
    assert abs(wave.period_mm - 10.0) < 4 * wave.u_period_mm + 2e-3
    assert abs(wave.amplitude_um - np.hypot(0.6, 0.3)) < 4 * wave.u_amplitude_um
    assert wave.frequency_hz == pytest.approx(500.0 / 60.0 / 10.0, rel=1e-3)


def test_table_steps_that_coarse_targets_miss():
    step = ("quantised-compensation:axis=X,step=13,pitch=36,offset=20",)
    case = virtual_case(0, step, targets=Targets(90.0, both=False))
    found = estimate(case.measured.records, case.quasi)
    jumps = found.by_direction[1].jumps
    assert len(jumps.positions_mm) == 12
    assert np.abs(np.array(jumps.sizes_um) - 13.0).max() < 0.5
    assert jumps.pitch is not None
    assert jumps.pitch[0] == pytest.approx(36.0, abs=4 * jumps.pitch[1])
    table = found.table()
    off = table.error - case.truth(table.position, 1)
    assert np.mean(np.abs(off) < 3 * table.u) > 0.97
    assert (
        np.ptp(
            case.quasi.deviation - np.polyval(np.polyfit(case.quasi.target, case.quasi.deviation, 3), case.quasi.target)
        )
        < 13.0
    )


def test_a_vibration_is_no_cyclic_error():
    case = virtual_case(0, feed=5000.0, laser=Laser(1000.0, vibrations=((35.0, 0.5),)))
    found = estimate(case.measured.records, case.quasi)
    assert [round(wave.period_mm) for wave in found.by_direction[1].waves] == [10]
    frequency, amplitude = found.by_direction[1].noises[0].vibrations[0]
    assert frequency == pytest.approx(35.0, abs=2.0)
    assert amplitude == pytest.approx(0.5, rel=0.3)
    table = found.table()
    assert rms((table.error - case.truth(table.position, 1))[table.continuous]) < 0.2


def test_a_wave_at_another_phase_in_another_run_belongs_to_time():
    quasi = readings([5.0, 50.0, 100.0, 150.0, 190.0], [0.0] * 5)
    courses = []
    for phase in (0.0, 2.0):
        record = straight(2000, error=lambda x, phase=phase: 0.5 * np.sin(2 * np.pi * x / 7.0 + phase), seed=int(phase))
        courses.append(course_of(record, constant_velocity(record), quasi))
    found = features(courses)
    assert found.periods == ()
    assert found.bound_to_time[0][0] == pytest.approx(10.0 / 7.0, rel=0.01)
    assert features(courses[:1]).periods[0] == pytest.approx(7.0, rel=0.01)


def test_noise_says_what_it_is():
    rng = np.random.default_rng(0)
    record = straight(8000, noise=0.0)
    quasi = readings([5.0, 100.0, 700.0], [0.0] * 3)
    course = course_of(record, constant_velocity(record), quasi)
    white = noise_of_course(course, 0.3 * rng.standard_normal(len(course)))
    assert white.order == 0
    assert white.total == pytest.approx(0.3, rel=0.05)
    wind = np.zeros(len(course))
    for i in range(1, len(wind)):
        wind[i] = -0.6 * wind[i - 1] + 0.3 * rng.standard_normal()
    blue = noise_of_course(course, wind)
    assert blue.order >= 1
    assert blue.innovation == pytest.approx(0.3, rel=0.1)
    assert blue.filter[1] == pytest.approx(0.6, abs=0.1)


# ---- shape and fusion against dense oracles


def test_the_shape_is_the_error_within_its_uncertainty():
    """Up to a line, of a sine with a jump of 2 um at 12 mm and a wave of 0.5 um and 3 mm, over the noise of 40 runs."""
    at = np.concatenate([np.arange(3.0, 12.0, 0.5), np.arange(12.5, 27.0, 0.5)])
    line = np.stack([np.ones_like(at), at], axis=1)

    def error(x):
        return np.sin(x) + 2.0 * (x >= 12.0) + 0.5 * np.sin(2.0 * np.pi * x / 3.0)

    squares, variances, jumps = [], [], []
    for seed in range(40):
        record = straight(300, speed=10.0, error=error, seed=seed)
        course = course_of(record, constant_velocity(record), readings([5.0, 15.0, 25.0], [0.0] * 3))
        shape = shape_of([course], [Noise(np.ones(1), 0.1, 0.1, 2e-4, ())], Extra((12.0,), (3.0,)))
        free = np.eye(len(at)) - line @ np.linalg.pinv(line)
        squares.append(np.mean((free @ (shape.at(at) - error(at))) ** 2))
        variances.append(np.mean(np.diag(free @ shape.covariance(at) @ free)))
        jumps.append((shape.amounts[0] - 2.0) / np.sqrt(shape.amount_covariance()[0, 0]))
        assert shape.noise_scale == pytest.approx(1.0, abs=0.3)
    assert 0.7 < np.sqrt(np.mean(squares) / np.mean(variances)) < 1.2
    assert 0.5 < np.sqrt(np.mean(np.square(jumps))) < 1.4


def test_two_runs_are_better_than_one():
    quasi = readings(np.arange(5.0, 196.0, 10.0), np.sin(np.arange(5.0, 196.0, 10.0) / 20.0), u=0.02)
    runs = [straight(2000, noise=0.3, seed=k, error=lambda x: np.sin(x / 20.0)) for k in range(4)]
    runs = [replace(run, name=f"{k} forward") for k, run in enumerate(runs)]
    at = np.linspace(10.0, 190.0, 19)
    one, four = (estimate(some, quasi, positions=at) for some in (runs[:1], runs))
    assert rms(four.table().u) < rms(one.table().u)
    assert rms(four.fused.values[0] - np.sin(at / 20.0)) < 0.06


def test_both_directions_and_their_reversal():
    case = virtual_case(2, ("backlash:axis=X,width=12",), both=True, targets=Targets(45.0, 3))
    at = np.linspace(10.0, 440.0, 44)
    found = estimate(case.measured.records, case.quasi, positions=at)
    assert found.direction == "mean"
    for i, sign in enumerate((1, -1)):
        off = found.fused.values[i] - case.truth(at, sign)
        assert rms(off) < 0.15
    reversal, covariance = found.curve("reversal")
    assert np.abs(reversal.mean() - (case.truth(at, 1) - case.truth(at, -1)).mean()) < 4 * np.sqrt(covariance.mean())
    mean = found.curve("mean")[0]
    assert mean == pytest.approx((found.fused.values[0] + found.fused.values[1]) / 2)


def test_the_other_direction_from_readings_alone():
    case = virtual_case(2, ("backlash:axis=X,width=12",), targets=Targets(45.0, 3))
    at = np.linspace(10.0, 440.0, 44)
    found = estimate(case.measured.records, case.quasi, positions=at, direction="backward")
    off = found.curve("backward")[0] - case.truth(at, -1)
    assert rms(off) < 0.2
    assert rms(found.table("backward").u) > rms(found.table("forward").u)
    forward = case.quasi.rows(np.flatnonzero(case.quasi.direction == 1))
    with pytest.raises(UserError, match="have only forward"):
        estimate(case.measured.records, forward, direction="backward")


def test_a_run_without_readings_of_its_direction_is_told():
    case = virtual_case(2, both=True, targets=Targets(45.0, both=False))
    found = estimate(case.measured.records, case.quasi)
    assert found.direction == "forward"
    assert any("backward is not used" in note for note in found.notes)


def test_drift_between_runs():
    case = paper_case(0)
    rng = np.random.default_rng(1)
    targets = np.arange(0.0, 1001.0, 50.0)
    offsets, slopes = np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), np.array([-4.0, -2.0, 0.0, 2.0, 4.0])
    values = [
        case.truth(targets) + a + b * (targets - 500.0) * 1e-3 + 0.1 * rng.standard_normal(21)
        for a, b in zip(offsets, slopes, strict=True)
    ]
    parts = [readings(targets, each, run=str(k)) for k, each in enumerate(values)]
    quasi = QuasiStatic(
        np.concatenate([p.target for p in parts]), np.concatenate([p.deviation for p in parts]),
        np.concatenate([p.direction for p in parts]), np.concatenate([p.run for p in parts]), 0.1, source="t",
    )  # fmt: skip
    found = estimate([case.record], quasi)
    for drift, offset, slope in zip(found.fused.drift, offsets, slopes, strict=True):
        # the drift is against the mean of the runs, whose own place is as uncertain as their scatter makes it
        assert drift.offset_um == pytest.approx(offset, abs=0.15)
        assert drift.slope_um_per_m == pytest.approx(slope, abs=0.5)
    assert found.fused.spread.offset == pytest.approx(np.std(offsets, ddof=1), rel=0.3)
    assert found.fused.spread.noise < 0.2
    table = found.table()
    assert table.u.min() > 0.5 * np.std(offsets, ddof=1) / np.sqrt(5)


def test_targets_that_are_too_few():
    case = paper_case(0)
    few = case.quasi.rows(np.array([0, 4, 10]))
    with pytest.raises(UserError, match="1 target forward"):
        estimate([case.record], few)
    two = replace(case.quasi.rows(np.array([0, 2, 8, 10])), u=None)
    with pytest.raises(UserError, match="two targets inside"):
        estimate([case.record], two)
    assert rms(estimate([case.record], replace(two, u=0.15)).table().u) > 0.1


# ---- a real axis


@pytest.mark.statistical
def test_real_slit_axis_from_readings_that_alias_its_error(slit_log):
    header = {
        "command": "IOC_TEST:Axis1-PosAct",
        "observed": "IOC_TEST:ec0-s4-EL7211-Enc-PosAct",
        "axis": "X",
        "u_um": "0.3",
    }
    single = machines.load("examples/single_axis.toml")
    measured = read_any(slit_log, single, header=header)
    x, error, time = measured.state.positions[:, 0], measured.observed[:, 0] * 1e3, measured.state.time
    record = Record("1 forward", 1, time, x + 1e-3 * error, float(x[0]), float(x[-1]), 15.0, "slit")
    nearest = [int(np.argmin(np.abs(x - target))) for target in np.arange(1.0, 11.5, 1.0)]
    quasi = readings(np.round(x[nearest], 6), error[nearest], u=0.3)
    found = estimate([record], quasi)
    table = found.table()
    off = table.error - np.interp(table.position, x, error)
    assert np.ptp(quasi.deviation) < 3.0
    assert np.ptp(table.error) > 38.0
    assert rms(off[table.continuous]) < 0.4
    assert found.by_direction[1].waves[0].period_mm == pytest.approx(0.25, abs=1e-4)
    assert found.by_direction[1].waves[0].amplitude_um == pytest.approx(20.5, abs=0.5)


def test_the_travel_of_a_virtual_run_is_that_of_the_command():
    case = virtual_case(0, (), laser=Laser(100.0, 0.0), ends=False)
    record = case.measured.records[0]
    assert record.displacement[0] == pytest.approx(0.0, abs=1e-6)
    expected = TRAVEL + 1e-3 * (case.truth(np.array([TRAVEL]), 1)[0])
    assert record.displacement[-1] == pytest.approx(expected, abs=2e-5)
