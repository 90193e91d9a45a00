"""Selection: what is taken in, what goes again, and what is not blamed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.library.candidate import RARE, Candidate, at_zero
from calibration.diagnosis.search.common_causes import commoner, drifting, knocked
from calibration.diagnosis.search.evaluation import (
    SIGNS,
    SURE_OF_RARE,
    Evaluated,
    Sibling,
    evaluate,
    passing,
    predicts,
    siblings,
    standard_error,
)
from calibration.diagnosis.search.shapes.proposed_shapes import finer, joined
from calibration.diagnosis.search.stage import chosen_of, unconfirmed
from calibration.diagnosis.search.start_model import Base
from hypothesis import given
from hypothesis import strategies as st
from shop_floor.question import ask
from support.command import succeed
from support.diagnosis_cases import data_with, framed, selector

from calibration.diagnosis import searched_causes
from calibration.diagnosis.search import evaluation, recent_fits, selection
from kinematics.basis import Fourier
from kinematics.effects import (
    Backlash,
    Cyclic,
    ErrorMotion,
    GrowthWithSensor,
    GrowthWithTime,
    LateralPlay,
    LocationJump,
    StationShift,
    ThermalDrift,
    TrackerDrift,
)

BACKLASH = Backlash("X", 12.0)
SECOND = Backlash("Z", 16.0)
SOME = (Candidate(Backlash("X", 0.0)), Candidate(Backlash("Y", 0.0)), Candidate(Backlash("Z", 0.0)))


def alone(chosen, data):
    """A selector whose library is just these."""
    return replace(selector(data), library=chosen)


def names(stage):
    return [each.candidate.effect.name for each in stage.accepted]


@pytest.fixture
def no_shapes(monkeypatch):
    """Nothing is proposed from residuals."""
    monkeypatch.setattr(selection.scans, "proposals", lambda *_: [])


@pytest.mark.usefixtures("no_shapes")
def test_causes_are_found_one_by_one_and_fitted_along():
    found = alone(SOME, data_with(BACKLASH, SECOND)).select()
    assert len(found.stages) == 3
    last = found.stages[-1]
    assert sorted(names(last)) == sorted([SOME[0].effect.name, SOME[2].effect.name])
    width = last.fit.model.effects[last.numbers[names(last).index(SOME[0].effect.name)]]
    assert width.parameters[0] == pytest.approx(12.0, abs=3 * width.uncertainties[0])
    assert last.cost < found.stages[0].cost
    assert last.held_out_um < found.stages[0].held_out_um


@pytest.mark.usefixtures("no_shapes")
def test_nothing_is_found_in_noise():
    found = alone(SOME, data_with(seed=11)).select()
    assert not found.stages[-1].accepted
    assert len(found.last_round) == len(SOME)


@pytest.mark.usefixtures("no_shapes")
def test_what_does_not_pay_goes_again():
    made = alone(SOME, data_with(BACKLASH))
    both = made.stage([(SOME[0], np.array([0.5])), (SOME[1], np.array([0.5]))])
    assert names(made.pruned(both)) == [SOME[0].effect.name]


def test_without_causes_the_bases_of_the_search_stay_only_if_they_predict_as_well():
    bent = ErrorMotion("X", "X", Fourier((0.0, 600.0), (1.0,)), (0.0, 0.0, 0.0, 160.0), u=(0.0,) * 4)
    data = data_with(bent)
    good, poor = selector(data), selector(data, order=1)
    assert poor.bare.held_out_um > good.bare.held_out_um
    for first, searched in ((good, poor), (poor, good)):
        without, found = (searched_causes.Found(each, each.bare, ()) for each in (first, searched))
        found, *_ = searched_causes._without_impostors(found, without, without.stage)
        assert found.selector is good


def test_a_finer_motion_is_held_against_the_coarse_one_in_its_place():
    """A motion of 20 um that the coarse basis holds is not to the finer one's credit."""
    smooth = ErrorMotion("X", "X", Fourier((0.0, 600.0), (0.5,)), (0.0, 0.0, 20.0, 10.0), u=(0.0,) * 4)
    made = selector(data_with(smooth))
    base = made.stage([])
    one = next(each for each in finer(base.linearised) if each.replaces == "E_XX")
    stage = made.stage([(one, np.zeros(len(one.effect.parameters)))])
    assert stage.accepted[0].score.gain < 40.0
    assert made.base.lacking(stage.linearised, (one, stage.numbers[0])).squares == pytest.approx(
        base.linearised.squares, rel=0.05
    )
    assert stage.without(0).squares == pytest.approx(base.linearised.squares, rel=0.05)
    assert not made.pruned(stage).accepted


def test_a_ripple_is_to_the_finer_motions_credit():
    ripple = ErrorMotion("X", "X", Fourier((0.0, 600.0), (6.0,)), (0.0, 0.0, 12.0, 0.0), u=(0.0,) * 4)
    made = selector(data_with(ripple, n=160))
    base = made.stage([])
    one = min(evaluate(base.linearised, list(finer(base.linearised))), key=lambda each: each.score.delta_bic).candidate
    assert one.replaces == "E_XX"
    stage = made.stage([(one, np.zeros(len(one.effect.parameters)))])
    assert stage.accepted[0].score.delta_bic < -50.0
    assert made.pruned(stage) is stage


def test_a_harmonic_that_comes_later_joins_its_wave():
    truth = Cyclic(component="X", axis="X", period=40.0, sine=(14.0, 0.0, 5.0), cosine=(0.0, 0.0, 0.0))
    made = selector(data_with(truth, n=160))
    one, third = (
        Candidate(Cyclic(component="X", axis="X", period=period, sine=(0.0,), cosine=(0.0,)), 1, 1000.0)
        for period in (40.0, 40.0 / 3)
    )
    other = Candidate(Cyclic(component="Y", axis="X", period=20.0, sine=(0.0,), cosine=(0.0,)), 1, 1000.0)
    apart = made.stage([(each, np.ones(2)) for each in (one, third, other)])
    (_, whole) = made.joined(apart).accepted
    assert whole.candidate.effect.period == pytest.approx(40.0, rel=5e-3)
    assert len(whole.candidate.effect.sine) == 3


def test_waves_that_are_no_harmonics_stay_apart():
    def wave(component, period, harmonics=1):
        zero = (0.0,) * harmonics
        return Cyclic(component=component, axis="X", period=period, sine=zero, cosine=zero)

    assert joined(wave("X", 12.0), wave("X", 6.0)) == wave("X", 12.0, 2)
    assert joined(wave("X", 4.0), wave("X", 12.0)) == wave("X", 12.0, 3)
    assert joined(wave("X", 6.0, 2), wave("X", 12.0, 3)) == wave("X", 12.0, 4)
    assert joined(wave("X", 12.0), wave("Y", 6.0)) is None
    assert joined(wave("X", 12.0), wave("X", 12.05)) is None
    assert joined(wave("X", 12.0), wave("X", 6.5)) is None
    assert joined(wave("X", 12.0), wave("X", 6.0, 5)) is None


def test_what_is_hardly_visible_shields_others_from_blame():
    linearised = framed(BACKLASH)
    (good,) = evaluate(linearised, SOME[:1])
    assert [each.candidate for each in passing(linearised, [good])] == [SOME[0]]
    unseen = good.projected._replace(schur=good.projected.schur * 1e-6)
    assert unseen.visible < evaluation.SEEN
    hidden = Evaluated(SOME[1], unseen, good.score)
    assert not list(passing(linearised, [hidden]))
    better = hidden._replace(score=good.score._replace(delta_bic=good.score.delta_bic - 20.0))
    assert not list(passing(linearised, [better, good]))
    # where it explains as much, it is a sibling
    assert [each.candidate for each in passing(linearised, [good, hidden])] == [SOME[0]]


def test_a_size_beyond_what_is_physical_is_not_named():
    linearised = framed(BACKLASH)
    (good,) = evaluate(linearised, SOME[:1])
    size = np.array([1.01 * evaluation.LARGEST])
    assert not list(passing(linearised, [good._replace(score=good.score._replace(size=size))]))


def test_siblings_do_much_the_same():
    linearised = framed(BACKLASH)
    made = alone(SOME, linearised.measurement)
    stage = made.stage([(SOME[0], np.array([0.6]))])
    (accepted,) = stage.accepted
    twin = Candidate(ThermalDrift(component="X", rate=0.0))
    without = stage.without(0)
    same = Evaluated(
        twin, without.projected(without.columns(accepted.candidate.effect)), evaluate(without, SOME[:1])[0].score
    )
    found = siblings(without, accepted.candidate, [*evaluate(without, SOME), same])
    assert [sibling.evaluated.candidate for sibling in found] == [twin]
    assert found[0].cosine == pytest.approx(1.0, abs=1e-6)
    assert found[0].log_odds == pytest.approx(0.0, abs=0.5)
    assert chosen_of(stage.accepted)[0][0] is accepted.candidate


@given(st.lists(st.floats(-100.0, 100.0, width=32), min_size=2, max_size=40), st.integers(-20, 20))
def test_prediction_does_not_depend_on_units(gains, octaves):
    gains = np.array(gains)
    if abs(gains.mean()) > 1e-6 and gains.std() > 1e-6:
        assert predicts(gains) == predicts(gains * 2.0**octaves)


@given(st.lists(st.floats(0.1, 100.0), min_size=2, max_size=40))
def test_what_gains_in_every_block_predicts_and_what_loses_does_not(gains):
    assert predicts(np.array(gains))
    assert not predicts(-np.array(gains))


@pytest.mark.parametrize(("lost", "blocks", "rare"), [(0, 3, True), (1, 7, True), (2, 8, False), (3, 16, True)])
def test_few_blocks_that_gain_by_chance_are_not_enough_for_a_rare_cause(lost, blocks, rare):
    """A cause that gains most in one block, and loses in some: the mean is within two standard errors."""
    gains = np.array([10.0 * blocks, *[-1.0] * lost, *[1.0] * (blocks - lost - 1)])
    assert gains.mean() < SURE_OF_RARE * standard_error(gains)
    assert predicts(gains, SURE_OF_RARE)
    assert predicts(gains, SURE_OF_RARE, SIGNS) == rare


@pytest.mark.parametrize(("delta_bic", "lost", "stands"), [(-15.0, 2, False), (-15.0, 1, True), (-25.0, 2, True)])
def test_a_rare_cause_that_the_final_bases_leave_little_is_confirmed_by_held_out_blocks(delta_bic, lost, stands):
    gains = np.array([80.0, *[-1.0] * lost, *[1.0] * (7 - lost)])
    made = alone(SOME, framed(BACKLASH).measurement)
    play, lag = Candidate(LateralPlay("A", "Y", 0.0)), Candidate(Backlash("X", 0.0))
    stage = made.stage([(play, np.zeros(1)), (lag, np.zeros(1))])
    accepted = tuple(
        replace(each, score=each.score._replace(delta_bic=delta_bic), held_out=lambda: gains) for each in stage.accepted
    )
    rare = [] if stands else [accepted[0]]
    assert unconfirmed(stage._replace(accepted=accepted)) == rare


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60))
def test_false_discoveries_are_held_as_benjamini_and_hochberg_say(p_values):
    limit = evaluation._discovered(p_values)
    ordered = sorted(p_values)
    allowed = [p for k, p in enumerate(ordered, 1) if p <= evaluation.FALSE * k / len(ordered)]
    assert limit == (max(allowed) if allowed else 0.0)


def test_a_cause_takes_the_form_that_explains_more():
    """A linear drift, taken for one that comes to rest, is replaced; another cause is not tried for the difference."""
    data = data_with(ThermalDrift("Z", amplitudes=(60.0,), time_constants_s=(300.0,)))
    forms = (
        Candidate(ThermalDrift("Z", rate=0.0)),
        Candidate(ThermalDrift("Z", amplitudes=(0.0,), time_constants_s=(600.0,)), 1, 3.0),
    )
    chooses = alone(forms, data)
    linear = chooses.stage([(forms[0], np.array([1.0]))])
    refined = chooses.refined(linear)
    assert refined.accepted[0].candidate.effect.time_constants_s
    assert refined.cost < linear.cost
    assert chooses.refined(refined) is refined


def test_a_drift_along_three_axes_is_not_one_of_the_tracker():
    """A common cause replaces a rare one, although each of its directions alone explains much less."""
    sizes = {"X": 20.0, "Y": -15.0, "Z": 40.0}
    vector = (ThermalDrift(c, amplitudes=(size,), time_constants_s=(600.0,)) for c, size in sizes.items())
    forms = [Candidate(ThermalDrift(c, amplitudes=(0.0,), time_constants_s=(600.0,)), 1, 4.0) for c in sizes]
    made = alone([*forms, Candidate(TrackerDrift())], data_with(*vector))
    (rare,) = evaluate(made.bare.linearised, made.library[3:])
    tracker = made.stage([(rare.candidate, rare.score.size)])
    (drift,) = drifting(made, tracker, 0)
    assert len(drift) == len(sizes)
    found = commoner(made, tracker)
    assert {each.candidate.kind for each in found.accepted} == {"thermal-drift"}


def test_a_growth_is_refined_to_the_fixed_point_that_the_data_show():
    """The point was proposed before other errors were known; its error would be called a drift along the axis."""
    warm = {"temperatures": {"column": np.linspace(0.0, 3.0, 100)}}
    data = data_with(GrowthWithSensor(axis="X", sensor="column", coefficient=90.0, fixed_point=200.0), **warm)
    (found,) = evaluate(
        (made := alone([], data)).bare.linearised,
        [Candidate(GrowthWithSensor(axis="X", sensor="column", coefficient=0.0, fixed_point=80.0), 1)],
    )
    refined = made.refined(made.stage([(found.candidate, found.score.size)]))
    assert refined.accepted[0].candidate.effect.fixed_point == pytest.approx(200.0, abs=10.0)
    assert refined.accepted[0].candidate.shapes == 1


@pytest.mark.usefixtures("no_shapes")
def test_a_quantity_of_the_machine_jumps_once():
    first, second = (Candidate(LocationJump("X", "X", 0.0, since), 1, 90.0) for since in (400.0, 900.0))
    made = alone([], data_with(LocationJump("X", "X", 40.0, 400.0), LocationJump("X", "X", 60.0, 900.0)))
    stage = made.stage([(first, np.array([2.0]))])
    proposing = replace(made, search=replace(made.search, proposals=lambda *_: [second]))
    assert proposing.evaluated(stage.linearised, ())
    assert not proposing.evaluated(stage.linearised, stage.accepted)


def test_the_noise_of_an_axis_does_not_hide_a_cause_along_it():
    """What an estimated non-repeatability of Z contains is tried with even noise as well."""
    data = data_with(ThermalDrift("Z", rate=60.0))
    made = alone([Candidate(ThermalDrift("Z", rate=0.0)), *SOME], data)
    found = made._found(made._tried(made.bare, ""), (), set())
    assert [each.candidate.axis for each in found] == ["Z"]
    assert made.bare.linearised.evenly_noisy.measurement.noise is None


@pytest.mark.usefixtures("no_shapes")
def test_another_direction_of_a_drift_is_likelier_than_another_cause():
    drifts = [Candidate(ThermalDrift(c, rate=0.0)) for c in "XZ"]
    made = alone([*drifts, *SOME], data_with(BACKLASH))
    besides, along = evaluate(made.bare.linearised, SOME[:1])[0], evaluate(made.bare.linearised, drifts[:1])[0]
    stage = made.stage([(drifts[1], np.ones(1)), (SOME[0], np.ones(1))])
    found = made._compared(stage, 1, [Sibling(besides, 0.5, 6.0), Sibling(along, 0.5, 7.0)])
    assert [(each.evaluated, each.log_odds) for each in found] == [(along, 7.0 - RARE), (besides, 6.0)]
    assert made.stage([(drifts[0], np.ones(1)), (drifts[1], np.ones(1))]).rarity == -RARE
    alone_there = made.stage([(SOME[0], np.ones(1))])
    assert made._compared(alone_there, 0, [Sibling(along, 0.5, 7.0)])[0].log_odds == 7.0


@pytest.mark.usefixtures("no_shapes")
def test_the_machine_jumps_at_one_moment():
    """A crash may change several quantities; what jumps at another moment again is no crash."""
    first, other = Candidate(LocationJump("X", "X", 0.0, 400.0), 1, 90.0), Candidate(LocationJump("Y", "Y", 0.0, 900.0))
    made = alone([], data_with(LocationJump("X", "X", 40.0, 400.0), LocationJump("Y", "Y", 60.0, 400.0)))
    stage = made.stage([(first, np.array([2.0]))])
    proposing = replace(made, search=replace(made.search, proposals=lambda *_: [other]))
    (found,) = proposing.evaluated(stage.linearised, stage.accepted)
    assert (found.candidate.axis, found.candidate.effect.since_s) == ("Y", 400.0)
    assert proposing.evaluated(made.bare.linearised, ())[0].candidate.effect.since_s == 900.0


def test_a_whole_drift_stands_in_place_of_a_growth_beside_a_part_of_it():
    """A growth of X imitates the X part of a drift better than any single direction does, but not than the vector."""
    sizes = {"X": 40.0, "Y": -15.0, "Z": 80.0}
    vector = (ThermalDrift(c, amplitudes=(size,), time_constants_s=(600.0,)) for c, size in sizes.items())
    forms = [Candidate(ThermalDrift(c, amplitudes=(0.0,), time_constants_s=(600.0,)), 1, 4.0) for c in sizes]
    growth = Candidate(GrowthWithTime("X", 0.0, amplitudes=(0.0,), time_constants_s=(600.0,)), 1, 4.0)
    made = alone([*forms, growth], data_with(*vector))
    (scored,) = evaluate(made.bare.linearised, [growth])
    found = commoner(made, made.stage([(forms[2], np.ones(1)), (growth, scored.score.size)]))
    assert sorted(each.candidate.axis for each in found.accepted) == ["X", "Y", "Z"]
    assert {each.candidate.kind for each in found.accepted} == {"thermal-drift"}


def test_causes_of_nearly_the_same_sizes_have_the_same_fit():
    made, cause = selector(data_with(n=100)), Candidate(Backlash("X", 0.0))
    first = made.stage([(cause, np.full(1, 2.5))])
    assert made.stage([(cause, np.full(1, 3.5))]).fit is first.fit
    assert made.stage([(cause, np.full(1, 4.5))]).fit is not first.fit


def test_gains_on_held_out_blocks_are_those_of_the_cause_on_the_fit_without_it():
    stage = selector(data_with(BACKLASH, SECOND)).stage(
        [(Candidate(Backlash(axis, 0.0)), np.ones(1)) for axis in ("X", "Z")]
    )
    for i, each in enumerate(stage.accepted):
        without = stage.without(i)
        gains = without.held_out_gains(without.candidate(each.candidate.effect))
        assert each.held_out_gains == pytest.approx(gains)
        assert each.sureness > 1.0


def test_a_cause_far_beyond_any_other_is_not_left_out_again(monkeypatch):
    """The fit without it is not made."""
    chosen = [
        (Candidate(Backlash("X", 0.0)), np.ones(1)),
        (Candidate(Cyclic("X", "X", 20.0, (0.0,), (0.0,)), 1), np.ones(2)),
    ]
    made = selector(data_with(Backlash("X", 60.0), Cyclic("X", "X", 20.0, (60.0,), (0.0,))))
    stage = made.stage(chosen)
    monkeypatch.setattr(Base, "fit", lambda *_: pytest.fail("a fit"))
    assert made.leaner(stage) is stage


def test_the_same_causes_are_fitted_once(monkeypatch):
    fits, fit = [], Base.fit
    monkeypatch.setattr(Base, "fit", lambda *given: fits.append(given) or fit(*given))
    made, cause = selector(data_with(n=100)), Candidate(Backlash("X", 0.0))
    first = made.stage([(cause, np.ones(1))])
    assert made.stage([(cause, np.ones(1))]).fit is first.fit
    assert len(fits) == 1
    # another prior is another fit, and only the last fits are kept
    for power in range(1, recent_fits.RECENT + 1):
        made.stage([(cause, np.full(1, 2.0**power))])
    assert len(fits) == recent_fits.RECENT + 1
    assert len(made.recent.fits) == recent_fits.RECENT
    assert made.stage([(cause, np.ones(1))]).fit is not first.fit


MOMENT = 15.0 * 60
ZEROS = LocationJump("X", "X", 15.0, MOMENT), LocationJump("Y", "Y", -12.0, MOMENT)


@pytest.mark.parametrize(
    ("truth", "jumping", "kind"),
    [
        ((StationShift("s1", (15.0, -12.0, 0.0), (15.0, 10.0, -10.0), MOMENT),), ZEROS, "station-shift"),
        (ZEROS, ZEROS, "location-jump"),
        ((ZEROS[0], LocationJump("C", "Y", 90.0, MOMENT)), (), "location-jump"),
    ],
)
def test_jumps_at_one_moment_are_a_knock_where_one_explains_them(truth, jumping, kind):
    """Zeros that were lost at once may have the very signal of a knock."""
    made = replace(selector(data_with(*truth, n=120)), library=())
    jumps = [Candidate(at_zero(effect), 1, 100.0) for effect in jumping or truth]
    found = evaluate(made.bare.linearised, jumps)
    stage = knocked(made, made.stage([(each.candidate, each.score.size) for each in found]))
    assert {each.candidate.kind for each in stage.accepted} == {kind}


@pytest.mark.parametrize(("windup", "parameters"), [(None, 1), (400.0, 2)])
def test_the_plainer_form_of_a_cause_stands_where_a_full_fit_with_it_is_likelier(windup, parameters):
    made = selector(data_with(Backlash("X", 200.0, windup)))
    forms = [candidate for candidate in made.library if candidate.cause[:2] == ("backlash", "X")]
    (both,) = (candidate for candidate in forms if len(candidate.effect.parameters) == 2)
    stage = made.stage([(both, np.ones(2))])
    found = made.plainer(stage)
    assert len(found.accepted[0].candidate.effect.parameters) == parameters
    assert (found is stage) == (parameters == 2)


@pytest.mark.statistical
def test_odds_of_similar_causes_are_those_of_fits(tmp_path):
    """By linear terms a knock would be likelier than this large backlash, of nearly the same signal."""
    data, result = tmp_path / "data.csv", tmp_path / "result.json"
    data.write_text(ask("serpentine", "backlash", "gantry", 0, 85001).sheet())
    succeed("diagnose", str(data), "--machine", "gantry", "-o", str(tmp_path / "new.json"), "--json", str(result))
    found = json.loads(result.read_text())
    (backlash,) = found["effects"]
    assert found["accepted"]
    assert backlash["kind"] == "backlash"
    assert min(other["odds"] for other in backlash["alternatives"]) > 1.0
