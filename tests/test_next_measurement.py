"""What to measure next: what a measurement not yet made would show, and which one is asked for."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.next.predicted_information import PredictedInformation
from calibration.diagnosis.next.ranking import SURE, Question, Signal, proposed_measurements
from calibration.diagnosis.next.unexplained_shape import UnexplainedShape
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.search.derivatives import signals
from calibration.diagnosis.search.evaluation import SEEN
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from support.bench import BENCH, seen, shuffled, swept, to_and_fro, together
from support.diagnosis_cases import selector
from support.tiers import quick
from support.virtual_measurements import ONE, TRACKER, measured, positions

from calibration.diagnosis.diagnose import diagnose
from calibration.fit.fit import fit
from calibration.follow_up.designs import follow_up_designs
from calibration.observation.full_model import BasisChoice, with_effects
from kinematics.effects import (
    AirScale,
    AngleHarmonic,
    Backlash,
    CrossAxis,
    DriftWithSensor,
    GrowthWithTime,
    RangeOffset,
    Settling,
    ThermalDrift,
    TrackerDrift,
)
from kinematics.error_model.model import no_errors

BACKLASH_X, SETTLING_X = Backlash("X", 0.0), Settling(axis="X", share_ppm=0.0)
GROWN_WITH_Y = CrossAxis(
    component="X", axis="X", other="Y", own_interval=(0.0, 600.0), other_interval=(0.0, 600.0), own_degree=1,
    other_degree=2, coefficients=(0.0,) * 4,
)  # fmt: skip
DRIFTS = [ThermalDrift(component=c, rate=0.0) for c in "XYZ"]
GROWTH = [GrowthWithTime(axis=axis, rate=0.0) for axis in "XYZ"]
ENCODER = [AngleHarmonic(circle="azimuth", harmonic=k, sine_urad=0.0, cosine_urad=0.0) for k in (1, 2)]
LENGTHS = [RangeOffset(offset_um=0.0), AirScale(scale_um_per_m=0.0)]


def frame_of(measurement):
    model, prior = with_effects(measurement, {axis: BasisChoice("legendre", 5) for axis in "XYZ"}, (), 1.0)
    return LinearisedFit.of(fit(measurement, model, prior=prior))


def designs_after(fitted):
    return follow_up_designs(fitted.measurement, fitted.registration)


def planned(linearised, name):
    return next(plan for plan in designs_after(linearised.fit) if plan.name == name)


def shares(linearised, effects, name=None):
    predicted = PredictedInformation(linearised, effects)
    return shares_of(predicted, None if name is None else planned(linearised, name))


def shares_of(predicted, plan=None):
    known = predicted.now if plan is None else predicted.after(predicted.now, plan)
    return np.array([known.share(i) for i in range(len(predicted.effects))])


# ---- what a measurement would show


def shown(linearised, effect):
    """The visible share of a cause in two set-ups, with its state at the beginning of the second one unknown."""
    columns, later = linearised.columns(effect), linearised.measurement.groups[linearised.rows] != "1"
    state = linearised.measurement.state
    steady = replace(state, time=np.full_like(state.time, state.time.mean()))
    begun = signals(replace(linearised.measurement, state=steady), linearised.rows, [effect], linearised.transform)
    begun *= np.repeat(later, 3)[:, None] * ("time" in effect.needs)
    own, start = linearised.projected(columns), linearised.projected(begun)
    shared = begun.T @ columns - start.through.T @ own.through
    left = own.schur - shared.T @ np.linalg.pinv(start.schur, 1e-9) @ shared
    return np.sqrt(np.trace(left) / np.sum(columns**2))


def test_the_outlook_is_what_the_measurement_shows_once_it_is_made():
    data = seen(swept())
    linearised = frame_of(data)
    effects = [*DRIFTS, *GROWTH, *ENCODER, Backlash("X", 0.0), Settling(axis="Z", share_ppm=0.0)]
    for name in ("retrace", "shuffled", "other side", "finer Y"):
        plan = planned(linearised, name)
        both = replace(together(data, plan))
        then = frame_of(both)
        made = np.array([shown(then, effect) for effect in effects])
        assert shares(linearised, effects, name) == pytest.approx(made, abs=0.02)


def test_the_outlook_without_a_move_is_the_frame():
    linearised = frame_of(seen(swept()))
    effects = [*DRIFTS, *GROWTH, *LENGTHS]
    now = PredictedInformation(linearised, effects).now
    for i, effect in enumerate(effects):
        own = linearised.projected(linearised.columns(effect))
        assert now.schur(i) == pytest.approx(own.schur, rel=1e-6, abs=1e-6)
        assert now.share(i) == pytest.approx(own.visible, abs=1e-4)


def test_a_cause_beside_another_one_keeps_what_lies_across_it():
    linearised = frame_of(seen(to_and_fro()))
    effects = [Backlash("X", 0.0), Settling(axis="X", share_ppm=0.0), ThermalDrift(component="X", rate=0.0)]
    now = PredictedInformation(linearised, effects).now
    assert now.schur(0, beside=1)[0, 0] < 0.01 * now.schur(0)[0, 0]
    assert now.schur(0, beside=2)[0, 0] > 0.5 * now.schur(0)[0, 0]


def test_shuffled_order_shows_a_drift_about_twice_as_well_as_a_sweep():
    effects = DRIFTS + GROWTH
    in_order, in_disorder = (shares(frame_of(seen(q)), effects) for q in (swept(), shuffled()))
    assert np.all(in_disorder > 1.7 * in_order)


def test_a_retrace_of_another_set_up_shows_a_drift_within_each_of_the_two():
    # of a drift that starts at zero each of the two registrations takes the mean: what is left of it is a quarter
    assert shares(frame_of(seen(shuffled())), DRIFTS, "retrace") == pytest.approx(0.25, abs=0.02)
    assert np.all(shares(frame_of(seen(swept())), DRIFTS, "retrace") < 0.25)


def test_a_second_station_shows_encoders_and_the_order_of_the_chain():
    linearised = frame_of(seen(swept()))
    wrong_order = [
        CrossAxis(
            component=own, axis=own, other=other, own_interval=(0.0, 600.0), other_interval=(0.0, 600.0), own_degree=1,
            other_degree=2, coefficients=(0.0,) * 4,
        ) for own, other in ("XY", "YX")
    ]  # fmt: skip
    effects = [*ENCODER, *wrong_order]
    before = shares(linearised, effects)
    across, beside = (
        shares(linearised, effects, f"second station {place}")
        for place in ("across the volume", "a quarter round the volume")
    )
    assert np.all(beside[:2] > 3.0 * before[:2])
    assert np.all(across[2:] > 1.15 * before[2:])


def test_only_a_length_standard_shows_range_offset_and_air_scale():
    for q in (swept(), shuffled()):
        linearised = frame_of(seen(q))
        predicted = PredictedInformation(linearised, LENGTHS)
        assert shares_of(predicted).max() < SEEN
        for plan in designs_after(linearised.fit):
            then = shares_of(predicted, plan)
            assert (then.min() > SEEN) == (plan.name == "bar"), plan.name
            if plan.name != "bar":
                assert then.max() < SEEN, plan.name


# ---- ties: power after the measurement, with its own unknowns


HUGE = 300.0
"""Size of a cause, in typical sizes: no prior of a sibling may part what is parallel."""


def with_sensor(measurement, kelvin_per_h):
    """The data with a sensor that warms in proportion to the time."""
    kelvin = measurement.state.time / 3600.0 * kelvin_per_h
    return replace(measurement, state=replace(measurement.state, temperatures={"frame": kelvin}))


def powers(linearised, one, other, size=HUGE):
    """Power to separate two causes of a size, by design."""
    predicted = PredictedInformation(linearised, [one, other])
    now = predicted.now
    sizes = [size * np.ones(sum(q.linear for q in effect.parameter_table)) for effect in (one, other)]
    tie = Question("tied", one.name, other.name, (Signal(0, sizes[0], beside=1), Signal(1, sizes[1], beside=0)))
    found = {"now": tie.power(now, now)}
    return found | {plan.name: tie.power(predicted.after(now, plan), now) for plan in designs_after(linearised.fit)}


FIXED = {"fixed references", "many fixed references", "fixed references, fewer", "many fixed references, fewer"}
STATIONS = {"second station across the volume", "second station a quarter round the volume"}
ORDERS = {"retrace", "shuffled", "cold start"}
EVERYTHING = "every design but the parting ones"
TIES = {
    "tool and tracker, swept": (
        lambda: seen(swept()), ThermalDrift(component="Z", rate=0.0), TrackerDrift(), FIXED | {"bar"}, EVERYTHING,
    ),
    "tool and tracker, shuffled": (
        lambda: seen(shuffled()), ThermalDrift(component="X", rate=0.0), TrackerDrift(), FIXED, EVERYTHING,
    ),
    "range and air": (
        lambda: seen(shuffled()), RangeOffset(offset_um=0.0), AirScale(scale_um_per_m=0.0), {"bar"}, EVERYTHING,
    ),
    "moves of one length": (
        lambda: seen(to_and_fro()), BACKLASH_X, SETTLING_X, {"move lengths", "other side", "shuffled"},
        {"retrace", "fixed references", "bar", *STATIONS},
    ),
    "time and temperature": (
        lambda: with_sensor(seen(shuffled()), 3.0), ThermalDrift(component="Z", rate=0.0),
        DriftWithSensor(component="Z", sensor="frame", coefficient=0.0), set(), EVERYTHING,
    ),
    "growth in time and bending, swept": (
        lambda: seen(swept()), GrowthWithTime(axis="X", rate=0.0), GROWN_WITH_Y, ORDERS, {"other side", "bar", *STATIONS},
    ),
}  # fmt: skip
"""Data, two causes that are parallel in them, designs that part them, and designs in which they stay parallel."""


@pytest.mark.parametrize("case", TIES)
def test_only_designs_in_which_two_causes_are_not_parallel_separate_them(case):
    make, one, other, parting, staying = TIES[case]
    found = powers(frame_of(make()), one, other)
    assert found.pop("now") == 0.0
    assert all(found[name] > SURE for name in parting)
    assert all(found[name] == 0.0 for name in (set(found) - parting if staying == EVERYTHING else staying))


@pytest.mark.parametrize(
    ("design", "parts"), [("retrace", True), ("shuffled", True), ("other side", False), ("bar", False)]
)
def test_another_order_shows_whether_a_dependence_recurs_with_the_position_or_with_the_time(design, parts):
    linearised = frame_of(seen(swept()))
    shape = 2.0 * np.sin(np.arange(180) / 7.0)[:, None] * np.ones(3)
    unexplained = UnexplainedShape(linearised, Unexplained(("X", "time"), (0.3, 0.3), 0.005, 2.0, shape))
    predicted = PredictedInformation(linearised, [], unexplained)
    now = predicted.now
    both = Signal(0, np.ones(1), beside=1), Signal(1, np.ones(1), beside=0)
    open_question = Question("unexplained", "it", "", both)
    assert open_question.power(now, now) == 0.0
    power = open_question.power(predicted.after(now, planned(linearised, design)), now)
    assert power > 0.99 if parts else power == 0.0


def test_a_retrace_meets_the_positions_backwards_and_the_times_forwards():
    linearised = frame_of(seen(swept()))
    shape = np.random.default_rng(1).normal(size=(180, 3))
    unexplained = UnexplainedShape(linearised, Unexplained(("X",), (0.3,), 0.005, 1.0, shape))
    by_position, by_time = unexplained.after(planned(linearised, "retrace"), np.tile(np.eye(3), (180, 1, 1))).T
    assert by_position.reshape(180, 3)[::-1] == pytest.approx(by_time.reshape(180, 3))


# ---- what is asked for


DRIFT = ThermalDrift(component="Z", rate=12.0)


@pytest.mark.statistical
def test_fixed_references_and_nothing_else_tell_growth_from_a_drifting_tracker():
    found = diagnose(seen(shuffled(), DRIFT, seed=1))
    (cause,) = found.causes
    assert (cause.kind, cause.verdict, cause.alternatives[0].kind) == ("thermal-drift", "tied", "tracker-drift")
    separating = [move for move in found.proposed_measurements if "separates" in move.text]
    assert all("fixed references" in move.name for move in separating)
    assert not any("separates" in move.text for move in found.proposed_measurements if "fixed" not in move.text)
    assert "separates thermal-drift Z from tracker-drift (power " in found.next_measurement
    assert "fixed targets" in found.next_measurement


@pytest.mark.statistical
def test_fixed_references_make_a_drift_of_the_machine_sure():
    data = seen(shuffled(), DRIFT, seed=1)
    references = planned(diagnose(data).after.linearised, "many fixed references")
    again = diagnose(together(data, references, DRIFT))
    (cause,) = again.causes
    assert (cause.kind, cause.axis, cause.verdict) == ("thermal-drift", "Z", "strong")
    assert not any("separates" in move.text for move in again.proposed_measurements)


BACKLASH = Backlash("X", 12.0)


@pytest.fixture(scope="module")
def backlash_or_settling():
    """The diagnosis of backlash, measured with moves of one length only."""
    return diagnose(seen(to_and_fro(), BACKLASH))


@pytest.mark.statistical
def test_moves_of_other_lengths_tell_backlash_from_settling(backlash_or_settling):
    found = backlash_or_settling
    tied = {cause.kind for cause in found.causes if cause.verdict == "tied"}
    assert tied & {"backlash", "settling"}
    separating = {
        move.name for move in found.proposed_measurements if "separates backlash X from settling X" in move.text
    }
    assert "move lengths" in separating
    assert not separating & {"retrace", "bar", "fixed references"}
    assert found.proposed_measurements[0].name in separating


@pytest.mark.statistical
def test_moves_of_other_lengths_make_backlash_sure(backlash_or_settling):
    found, data = backlash_or_settling, seen(to_and_fro(), BACKLASH)
    again = diagnose(together(data, planned(found.after.linearised, "move lengths"), BACKLASH))
    assert ("backlash", "X", "strong") in [(cause.kind, cause.axis, cause.verdict) for cause in again.causes]


TIED = [
    (DRIFT, shuffled, 1, "retrace", False),
    (DRIFT, shuffled, 1, "shuffled", False),
    (DRIFT, shuffled, 1, "second station across the volume", False),
    (DRIFT, shuffled, 1, "many fixed references", True),
    (BACKLASH, to_and_fro, 2, "retrace", False),
    (BACKLASH, to_and_fro, 2, "second station across the volume", False),
    (BACKLASH, to_and_fro, 2, "shuffled", True),
    (BACKLASH, to_and_fro, 2, "other side", True),
]


@pytest.mark.parametrize(
    ("truth", "q", "seed", "design", "parts"),
    quick(TIED, [], [TIED[3], TIED[4]]),
)
def test_a_tie_is_parted_by_the_designs_that_are_said_to_part_it_and_by_no_others(truth, q, seed, design, parts):
    data = seen(q(), truth, seed=seed)
    found = diagnose(data)
    assert "tied" in {cause.verdict for cause in found.causes}
    said = {move.name for move in found.proposed_measurements if "separates" in move.text and move.minutes}
    assert (design in said) == parts
    again = diagnose(together(data, planned(found.after.linearised, design), truth))
    verdicts = {cause.effect.name: cause.verdict for cause in again.causes}
    if parts:
        assert verdicts[truth.name] == "strong"
    else:
        assert "tied" in verdicts.values()


@pytest.mark.statistical
def test_where_nothing_is_in_doubt_nothing_is_asked_for():
    found = diagnose(seen(shuffled(), Backlash("X", 12.0)))
    assert [(cause.effect.name, cause.verdict) for cause in found.causes] == [("backlash X", "strong")]
    assert {"tracker-range", "air-scale"} <= {hidden.name for hidden in found.not_visible}
    assert not found.proposed_measurements
    assert "bar" not in found.next_measurement
    assert found.accepted == ("No further measurement is needed" in found.next_measurement)


@pytest.mark.statistical
def test_moves_are_ranked_by_what_they_tell_per_minute(backlash_or_settling):
    found = backlash_or_settling
    gains = [move.gain_per_minute for move in found.proposed_measurements]
    assert len(set(gains)) > 1
    assert gains == sorted(gains, reverse=True)
    assert all(
        move.minutes > 0.0 and f"({move.minutes:.0f} min)" in move.text
        for move in found.proposed_measurements
        if move.gain_per_minute
    )


@pytest.mark.statistical
def test_a_weak_cause_is_made_sure_by_measuring_it_again():
    found = diagnose(seen(shuffled(), Backlash("X", 0.55), seed=11))
    weak = [cause.effect.name for cause in found.causes if cause.verdict == "weak"]
    assert weak == ["backlash X"]
    assert found.next_measurement.endswith(").")
    assert "confirms backlash X (power " in found.next_measurement


def test_what_a_tracker_did_before_it_was_moved_says_nothing_of_its_drift_after():
    linearised = frame_of(seen(shuffled()))
    predicted = PredictedInformation(linearised, [TrackerDrift()])
    now = predicted.now
    after = predicted.after(now, planned(linearised, "second station across the volume"))
    retraced = predicted.after(now, planned(linearised, "retrace"))
    assert np.trace(after.schur(0)) < 1.2 * np.trace(now.schur(0)) < np.trace(retraced.schur(0))


@pytest.mark.parametrize("again", [True, False])
def test_positions_are_measured_again_where_nothing_shows_the_noise(again):
    rng = np.random.default_rng(2)
    q = positions(BENCH, 40, rng)
    q = np.concatenate([q, q if again else positions(BENCH, 40, rng)])
    half = msgspec.structs.replace(TRACKER, u_range_um_per_m=0.25, u_angle_um=1.5, u_angle_um_per_m=1.5)
    data = replace(measured(BENCH, q, ONE, no_errors(BENCH), rng), instrument=half)
    proposed = list(proposed_measurements(selector(data).bare, (), None))
    assert [each.name for each in proposed] == ([] if again else ["retrace"])
    assert all("the instrument scatters more than specified, or the model lacks errors" in p.text for p in proposed)
