"""Causes that fine bases imitate, and corrections beside causes that are undecided.

Layers: an axis is approached from its second side at one end of its travel alone.
"""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.acceptance import against_undecided
from calibration.diagnosis.library.candidate import Candidate
from calibration.diagnosis.preparation import prepared
from calibration.diagnosis.residual.recurring import recurring
from calibration.diagnosis.search.evaluation import WORTH, evaluate
from calibration.diagnosis.search.imitated_causes import imitated
from calibration.diagnosis.search.shapes.change_points import breaks
from calibration.diagnosis.search.shapes.imitated_waves import imitated_wave
from calibration.diagnosis.searched_causes import Found
from calibration.diagnosis.unseen.undecided_causes import errors_by_undecided
from calibration.diagnosis.unseen.unseen_states import mean_squares, moments, rms_correction
from support.diagnosis_cases import CFRAME, data_with, fitted, selector
from support.tiers import quick
from support.virtual_measurements import ONE, measured, truth

from calibration.diagnosis import searched_causes
from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import Backlash, Cyclic, LocationJump, StationShift, TargetOffset
from kinematics.error_model.model import no_errors
from kinematics.running.progress import silent

LOW, HIGH = np.array([axis.travel for axis in CFRAME.axes]).T
LOST = Backlash("Y", 150.0)


def shares():
    """Three layers in turning lines, then three lines up, as shares of the travels."""
    along, across = np.linspace(0.05, 0.95, 7), np.linspace(0.05, 0.95, 5)
    rows = [(x, y, z) for z in (0.1, 0.5, 0.85) for j, y in enumerate(across) for x in along[:: 1 - 2 * (j % 2)]]
    return rows + [(x, y, z) for x, y in ((0.1, 0.1), (0.9, 0.2), (0.2, 0.9)) for z in np.linspace(0.1, 0.85, 6)]


def layers(*effects):
    """Layers of the C-frame with smooth error motions and these effects."""
    rng = np.random.default_rng(8)
    errors = truth(CFRAME, rng, 5.0)
    model = msgspec.structs.replace(no_errors(CFRAME), effects=(*errors.effects, *effects))
    return measured(CFRAME, LOW + np.array(shares()) * (HIGH - LOW), ONE, model, rng)


def part_lines(*effects):
    """Three lines along each axis, out and back, in a part of the volume of the C-frame with these effects."""
    rng, rows = np.random.default_rng(4), []
    for axis in (1, 0, 2):
        for at in rng.uniform(0.1, 0.8, (3, 3)):
            line = np.tile(at, (7, 1))
            line[:, axis] = np.linspace(0.1, 0.8, 7)
            rows += [line, line[::-1]]
    errors = truth(CFRAME, rng, 5.0)
    model = msgspec.structs.replace(no_errors(CFRAME), effects=(*errors.effects, *effects))
    return measured(CFRAME, LOW + np.concatenate(rows) * (HIGH - LOW), ONE, model, rng)


def unrepeatable(data, size=0.06):
    """The data of a machine whose Z is off by a random amount, mm, at each stop."""
    off = np.random.default_rng(1).normal(0.0, size, int(data.stops.max()) + 1)[data.stops]
    along = fitted(data).registration.rotations(data)[:, :, 2]
    observed = data.observed + off[:, None] * along
    return replace(data, observed=observed, state=replace(data.state, observed=observed))


@pytest.mark.statistical
def test_a_backlash_is_named_although_an_error_motion_can_bend_around_it():
    found = diagnose(layers(LOST))
    (cause,) = found.causes
    assert (cause.kind, cause.axis) == ("backlash", "Y")
    assert cause.effect.parameters[0] == pytest.approx(150.0, abs=3.0 * cause.effect.uncertainties[0])
    assert found.accepted


@pytest.mark.parametrize(
    ("true", "stands"),
    [(Cyclic("Z", "Z", 16.0, (40.0,), (0.0,)), False), (LocationJump("C", "X", 400.0, 945.0), True)],
)
def test_a_jump_that_errors_at_the_positions_of_an_axis_explain_is_none(true, stands):
    """A wave along Z shifts each line across Z as a whole."""
    made = selector(part_lines(true))
    linearised = made.stage([]).linearised
    jump = evaluate(linearised, [each for each in breaks(linearised) if isinstance(each.effect, LocationJump)])[0]
    stage = made.stage([(jump.candidate, jump.score.size)])
    assert stage.accepted[0].score.delta_bic < WORTH
    assert recurring(stage) == ([] if stands else list(stage.accepted))


def test_coarser_bases_stand_beside_a_cause_that_the_others_imitate():
    selector = prepared(layers(LOST), None, "sheet", silent, silent).selector
    beside, stage = imitated(selector, selector.bare)
    assert [each.candidate.cause[:2] for each in stage.accepted] == [("backlash", "Y")]
    parameters = [each.bare.linearised.posterior.effective_parameters for each in (selector, beside)]
    assert parameters[1] < parameters[0]


@pytest.mark.parametrize("urad", quick([60.0, 100.0], [], [60.0]))
def test_a_jump_behind_lines_that_have_positions_of_their_own_is_named(urad):
    """All lines along X lie before the collision; behind it each line has one position of X, which bases can bend."""
    data = part_lines(LocationJump("C", "X", urad, 1259.0))
    selector = prepared(data, None, "sheet", silent, silent).selector
    beside, stage = imitated(selector, selector.bare)
    assert [each.candidate.cause[2] for each in stage.accepted] in (["Csince"], ["since"])
    sizes = [sum(basis.size for basis in each.base.choice.bases.values()) for each in (selector, beside)]
    assert sizes[1] < sizes[0]
    (cause,) = diagnose(data).causes
    assert (cause.kind, cause.axis) == ("location-jump", "X")
    assert cause.effect.parameters[0] == pytest.approx(urad, abs=3.0 * cause.effect.uncertainties[0])


@pytest.mark.statistical
def test_a_wave_is_named_although_fine_bases_bend_through_its_positions():
    """Lines across Z lie at positions of their own: a jump, or a function of the readings, imitates the wave too."""
    data = part_lines(Cyclic("Z", "Z", 16.0, (40.0,), (0.0,)))
    selector = prepared(data, None, "sheet", silent, silent).selector
    beside, stage = imitated_wave(selector, selector.bare)
    assert [each.candidate.cause[:2] for each in stage.accepted] == [("cyclic", "Z")]
    parameters = [each.bare.linearised.posterior.effective_parameters for each in (selector, beside)]
    assert parameters[1] < parameters[0]
    (cause,) = diagnose(data).causes
    assert (cause.kind, cause.axis) == ("cyclic", "Z")
    assert cause.effect.period == pytest.approx(16.0, abs=0.02)


@pytest.mark.parametrize("made", quick([layers, part_lines], [], [layers]))
def test_nothing_is_imitated_where_nothing_is_hidden(made):
    selector = prepared(made(), None, "sheet", silent, silent).selector
    assert imitated(selector, selector.bare) == (selector, selector.bare)
    assert imitated_wave(selector, selector.bare) == (selector, selector.bare)
    assert diagnose(made()).causes == ()


@pytest.mark.statistical
def test_an_axis_that_does_not_repeat_may_have_lost_motion_that_the_model_has_learned():
    """Unless positions all over the travel are approached from both sides."""
    data = unrepeatable(layers(Backlash("Z", 120.0))), unrepeatable(data_with(n=123)), layers()
    found, scattered, quiet = (diagnose(each) for each in data)
    of_layers, of_scattered, none = (
        np.sqrt(mean_squares(errors_by_undecided(each.after.linearised, ()))) for each in (found, scattered, quiet)
    )
    for each in (found, scattered):
        assert (each.causes, list(each.after.fit.measurement.noise.non_repeatability)) == ((), ["Z"])
    assert of_layers[2] > 20.0
    assert 0.0 < of_scattered[2] < 10.0
    assert not none.any()
    assert found.widened > 1.5
    undecided_um = float(np.sqrt(mean_squares(errors_by_undecided(found.after.linearised, found.evaluated)).sum()))
    assert "leave open whether the new model is an improvement" in against_undecided(found.model, data[0], undecided_um)


@pytest.mark.statistical
def test_a_correction_must_be_larger_than_the_errors_of_undecided_causes():
    data = layers()
    model = diagnose(data).model
    size = rms_correction(model, data)
    assert size > 2.0
    assert against_undecided(model, data, 0.7 * size) == ""
    reason = against_undecided(model, data, 0.72 * size)
    assert f"{size:.3g} um RMS, and errors of {0.72 * size:.3g} um are expected" in reason


def test_unseen_states_have_directions():
    """Before its first move an axis has none, at unseen states it has."""
    data = layers()
    assert (data.state.approach == 0.0).any()
    for moment in moments(data):
        assert set(np.unique(moment.state.approach)) == {-1.0, 1.0}


@pytest.mark.statistical
def test_a_cause_is_compared_again_when_another_one_has_fallen(monkeypatch):
    """A knock had come in with another moment: only a target that was seated again was left for the true one."""
    data = part_lines()
    behind = data.state.time >= 945.0
    tilt = np.array([[0.0, -6e-5, 3e-5], [6e-5, 0.0, -5e-5], [-3e-5, 5e-5, 0.0]])
    observed = data.observed + behind[:, None] * (data.observed @ tilt.T + np.array([0.15, -0.1, 0.08]))
    made = selector(replace(data, observed=observed, state=replace(data.state, observed=observed)))
    seated = Candidate(TargetOffset(target="1", offset_um=(0.0, 0.0, 0.0), since_s=945.0), 1, 126.0)
    (station,) = set(data.groups.tolist())
    knock = Candidate(StationShift(station=station, since_s=1500.0), 1, 126.0)
    stage = made.stage([(seated, np.ones(3)), (knock, np.ones(6))])
    late = stage.accepted[1]
    monkeypatch.setattr(searched_causes, "DOUBTS", (lambda now: [each for each in now.accepted if each is late],))
    bare = Found(made, made.bare, ())
    found, _, _ = searched_causes._without_impostors(Found(made, stage, ()), bare, made.bare)
    (cause,) = found.stage.accepted
    assert (cause.candidate.kind, cause.candidate.effect.since_s) == ("station-shift", pytest.approx(945.0, abs=15.0))
