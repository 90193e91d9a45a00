"""Causes that error motions can imitate, because few rows show them apart.

Layers: an axis is approached from its second side at one end of its travel alone.
"""

import msgspec
import numpy as np
import pytest
from support.diagnosis_cases import CFRAME
from support.tiers import quick
from support.virtual_measurements import ONE, measured, truth

from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import Backlash, Cyclic, LocationJump
from kinematics.error_model.model import no_errors

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


@pytest.mark.statistical
def test_a_backlash_is_named_although_an_error_motion_can_bend_around_it():
    found = diagnose(layers(LOST))
    (cause,) = found.causes
    assert (cause.kind, cause.axis) == ("backlash", "Y")
    assert cause.effect.parameters[0] == pytest.approx(150.0, abs=3.0 * cause.effect.uncertainties[0])
    assert found.accepted


@pytest.mark.parametrize("urad", quick([60.0, 100.0], [], [60.0]))
def test_a_jump_behind_lines_that_have_positions_of_their_own_is_named(urad):
    """All lines along X lie before the collision; behind it each line has one position of X, which bases can bend."""
    (cause,) = diagnose(part_lines(LocationJump("C", "X", urad, 1259.0))).causes
    assert (cause.kind, cause.axis) == ("location-jump", "X")
    assert cause.effect.parameters[0] == pytest.approx(urad, abs=3.0 * cause.effect.uncertainties[0])


@pytest.mark.statistical
def test_a_wave_is_named_although_fine_bases_bend_through_its_positions():
    """Lines across Z lie at positions of their own: a jump, or a function of the readings, imitates the wave too."""
    (cause,) = diagnose(part_lines(Cyclic("Z", "Z", 16.0, (40.0,), (0.0,)))).causes
    assert (cause.kind, cause.axis) == ("cyclic", "Z")
    assert cause.effect.period == pytest.approx(16.0, abs=0.02)


@pytest.mark.parametrize("made", quick([layers, part_lines], [], [layers]))
def test_where_nothing_is_hidden_nothing_is_named(made):
    assert diagnose(made()).causes == ()
