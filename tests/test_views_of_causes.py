"""A figure for every kind of cause: readings of single rows, their means, and the fitted cause."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from support.effect_examples import EXAMPLES, full_state
from support.tiers import first_of_each, quick
from support.virtual_measurements import TRACKER, pose_of

import machines
from calibration.diagnosis.conclusion.fitted_rows import FittedRows
from calibration.fit.fit import fit
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.observation.normal_equations import whitened
from calibration.reports.causes.figures import cause_figure
from calibration.reports.causes.views import VIEWS, views
from kinematics.effects import EFFECTS, Backlash, CrossAxis, Cyclic, GrowthWithTime, Outliers
from kinematics.error_model.model import no_errors

CFRAME = machines.load("cframe")
MEDIAN = 0.674
"""Median of the absolute value of a standard normal variable: a few rows at the steps of a table do not count."""
TARGETS = {name: Target(place) for name, place in (("t1", (0.0, 0.0, -120.0)), ("t2", (90.0, 40.0, -180.0)))}


def seen_with(effect, machine, n=300, seed=1):
    """What a tracker sees of a machine without other errors, in states with every column; and the fitted effect."""
    state = with_moves(full_state(machine, n, seed))
    empty = Measurement(machine, TRACKER, state, np.ones((n, 3)), TARGETS, source="virtual")
    model = msgspec.structs.replace(no_errors(machine), effects=(effect,))
    points = empty.instrument.expected(empty, pose_of(["s1", "s2"]), no_errors(machine).observation(machine, state))
    state = replace(state, observed=points)
    exact = replace(empty, state=state)
    observed = exact.instrument.expected(exact, pose_of(["s1", "s2"]), model.observation(machine, state))
    noise = np.linalg.cholesky(TRACKER.covariance(observed)) @ np.random.default_rng(seed).normal(size=(n, 3, 1))
    found = fit(replace(exact, observed=observed + noise[:, :, 0]), model)
    white = found.measurement.whiteners
    transform = TRACKER.transform(found.measurement, found.registration)
    rows = FittedRows(found.measurement, white @ transform, whitened(white, found.residual), found.kept)
    return rows, found.model.effects[0]


SEEN = [example for example in EXAMPLES if example.touched]


def test_every_class_of_effect_has_its_own_view():
    assert set(VIEWS) == {effect.SHOWN_OVER for effect in EFFECTS}


@pytest.mark.parametrize(
    "example",
    quick(
        SEEN,
        first_of_each(SEEN, lambda example: VIEWS[example.effect.SHOWN_OVER]),
        first_of_each(SEEN, lambda example: type(example.effect)),
    )
    + [example for example in EXAMPLES if not example.touched],
    ids=lambda example: f"{example.effect.name} {example.machine.name}",
)
def test_every_kind_of_cause_yields_a_figure_whose_readings_scatter_by_their_uncertainty(example):
    if not example.touched:
        pytest.skip("does nothing that could be seen")
    data, effect = seen_with(example.effect, example.machine)
    panels = views(data, effect)
    assert panels
    for panel in panels:
        told = np.isfinite(panel.u)
        assert told.sum() > 100
        assert all(np.isfinite(column).all() for column in (panel.x, panel.y[told], panel.fitted[told]))
        assert panel.x_label
        assert panel.y_label.endswith(("um", "urad", "um/m", "uncertainty"))
        if not isinstance(effect, Outliers):
            scatter = np.median(np.abs((panel.y - panel.fitted) / panel.u)[told]) / MEDIAN
            assert 0.8 < scatter < 1.2
    assert len(cause_figure(panels).spec()["panels"]) == sum(1 if panel.over is None else 2 for panel in panels)


def test_readings_show_what_is_in_the_data():
    data, effect = seen_with(Backlash("X", 60.0), CFRAME)
    (panel,) = views(data, effect)
    forward, backward = (np.average(panel.y[rows], weights=panel.u[rows] ** -2) for _, rows in panel.groups)
    assert (forward, backward) == (pytest.approx(-30.0, abs=2.0), pytest.approx(30.0, abs=2.0))
    data, effect = seen_with(GrowthWithTime(axis="Y", rate=40.0, fixed_point=-100.0), CFRAME)
    (panel,) = views(data, effect)
    assert panel.y_label == "scale of Y, um/m"
    slope = np.polyfit(panel.x, panel.y, 1, w=1 / panel.u)[0]
    assert slope == pytest.approx(40.0, rel=0.05)


def test_a_map_of_a_cause_of_two_axes_has_both_panels():
    data, effect = seen_with(CrossAxis("Z", "X", "Y", (0.0, 500.0), (0.0, 400.0), 0, 1, (40.0,)), CFRAME)
    (panel,) = views(data, effect)
    assert (panel.x_label, panel.over_label) == ("X, mm", "Y, mm")
    slope = np.polyfit(panel.over, panel.y, 1, w=1 / panel.u)[0]
    assert slope == pytest.approx(np.polyfit(panel.over, panel.fitted, 1)[0], rel=0.2)
    assert [each.title for each in cause_figure([panel]).panels] == ["E_ZX, from the data", "E_ZX, fitted"]


def test_curves_are_those_of_the_cause():
    data, effect = seen_with(Cyclic("X", "X", 20.0, (30.0,), (0.0,)), CFRAME)
    (panel,) = views(data, effect)
    (curve,) = panel.curves
    amplitude = effect.sine[0]
    np.testing.assert_allclose(
        np.interp(curve.x, np.sort(panel.x), panel.fitted[np.argsort(panel.x)]), curve.y, atol=0.05 * abs(amplitude)
    )
    assert panel.x.max() < 20.1
