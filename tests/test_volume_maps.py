"""Maps of the volume: the exact errors relative to the centre on its planes, and their uncertainty."""

import msgspec
import numpy as np
import pytest
from support.programs import load, random_model

from kinematics.deviation import exact_deviation
from kinematics.effects import EFFECTS, Backlash, CrossAxis, LocationError, ThermalDrift
from kinematics.error_model.model import no_errors
from kinematics.state import State
from rendering.volume import CELLS, DRAWN_TOOL_MM, Field, uncertainty_of, volume_section


def drawn(machine, *fields):
    """The section, and the traces of each panel."""
    (section,) = volume_section(machine, fields)
    return section, [panel.traces for panel in section.figure().panels]


def relative_error(machine, model, q):
    """Exact errors of the tool point at axis positions `(n, axes)`, um, relative to the last one."""
    found = exact_deviation(machine, q, model.errors(machine, State(q)), (0.0, 0.0, -DRAWN_TOOL_MM)).position * 1e3
    return found[:-1] - found[-1]


@pytest.mark.parametrize("name", ["gantry", "cframe", "dmu50", "head_table"])
def test_planes_have_the_exact_errors_relative_to_the_centre(name):
    machine = load(name)
    model = random_model(machine, 3)
    section, panels = drawn(machine, Field("before", model))
    assert len(panels) == 3  # X Y, X Z and Y Z in the order of the axes
    linear = [i for i in range(len(machine.axes)) if not machine.rotary[i]]
    (heat, arrows), first, second = panels[0], *linear[:2]
    q = np.tile(np.array([axis.home for axis in machine.axes]) * machine.scale, (CELLS**2 + 1, 1))
    q[:, linear] = machine.travel[:, linear].mean(axis=0)
    x, y = np.meshgrid(heat["x"], heat["y"], indexing="ij")
    q[:-1, first], q[:-1, second] = x.ravel(), y.ravel()
    errors = relative_error(machine, model, q)
    np.testing.assert_allclose(np.ravel(heat["z"].T), np.linalg.norm(errors, axis=1), atol=1e-6)
    assert (min(heat["x"]), max(heat["x"])) == pytest.approx(machine.axes[first].travel)
    at = [
        np.argmin(np.abs(q[:-1, first] - a) + np.abs(q[:-1, second] - b))
        for a, b in zip(arrows["x"], arrows["y"], strict=True)
    ]
    np.testing.assert_allclose(arrows["customdata"], errors[at], atol=1e-6)
    most = max(np.max(traces[0]["z"]) for traces in panels)
    assert section.figure().colours["cmax"] == pytest.approx(most)


def test_an_arrow_points_to_the_side_to_which_the_tool_deviates():
    machine = load("cframe")  # its table carries X and Y
    squareness = LocationError("C", "Y", 100.0)
    model = msgspec.structs.replace(no_errors(machine), effects=(squareness,))
    _, panels = drawn(machine, Field("before", model))
    ((_, arrows), *_) = panels
    for angle, size, (x, y, _) in zip(
        arrows["marker"]["angle"], arrows["marker"]["size"], arrows["customdata"], strict=True
    ):
        if np.hypot(x, y) > 1.0:
            assert np.hypot(x, y) == pytest.approx(abs(x), rel=1e-3)
            assert angle == pytest.approx(90.0 * np.sign(x), abs=0.1)  # clockwise from upwards
            assert size > 4.0


def test_a_correction_by_the_same_model_leaves_nothing_but_the_uncertainty():
    machine = load("gantry")
    model = random_model(machine, 3)
    sure = msgspec.structs.replace(model, covariance=tuple(map(tuple, np.eye(len(model.parameters)).tolist())))
    section, panels = drawn(machine, Field("before", model), Field("after", model, model), uncertainty_of(sure))
    assert len(panels) == 9
    assert "After: 0.00 um RMS" in section.text
    assert all(len(traces) == 1 and np.max(traces[0]["z"]) > 0.1 for traces in panels[-3:])
    centre = panels[-1][0]["z"]
    assert centre[CELLS // 2, CELLS // 2] == pytest.approx(0.0, abs=1e-9)


def test_an_uncertainty_is_not_called_the_error_after_a_correction():
    machine = load("gantry")
    model = random_model(machine, 3)
    sure = msgspec.structs.replace(model, covariance=tuple(map(tuple, np.eye(len(model.parameters)).tolist())))
    section, _ = drawn(machine, Field("without a correction", model), uncertainty_of(sure))
    error, uncertainty, *_ = section.text.splitlines()
    assert "standard uncertainty (k=1)" in uncertainty
    assert "standard uncertainty" not in error
    assert not any(line.startswith(("Before", "After")) for line in section.text.splitlines())


def test_axes_that_were_not_measured_have_no_map():
    machine = load("gantry")
    plane = {name: machine.axes[machine.index(name)].travel for name in "XY"}
    flat = CrossAxis("Z", "X", "Y", plane["X"], plane["Y"], 1, 1, (20.0, 5.0))
    model = msgspec.structs.replace(no_errors(machine), effects=(flat,))
    section, panels = drawn(machine, Field("before", model))
    assert len(panels) == 1
    (only,) = section.figure().panels
    assert (only.x, only.y) == ("X, mm", "Y, mm")


def test_effects_of_time_are_left_out():
    machine = load("cframe")
    effects = (Backlash("X", 20.0), ThermalDrift(component="Z", rate=50.0))
    model = msgspec.structs.replace(no_errors(machine), effects=effects)
    section, panels = drawn(machine, Field("before", model))
    assert "leave out effects of time" in section.text
    assert all(np.max(traces[0]["z"]) == 0.0 for traces in panels)


def test_every_kind_of_effect_has_its_origin_and_its_repair():
    for effect in EFFECTS:
        assert all(text.endswith(".") for text in (*effect.WORKSHOP, *(effect.WORKSHOP_OF_ROTARY or ())))
