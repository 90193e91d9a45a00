"""Maps of the volume: the exact errors relative to the centre, and their uncertainty."""

import msgspec
import numpy as np
import pytest
from support.programs import load, random_model

from kinematics.deviation import exact_deviation
from kinematics.effects import EFFECTS, Backlash, ThermalDrift
from kinematics.effects.workshop import WORKSHOP
from kinematics.error_model.model import no_errors
from kinematics.state import State
from rendering.volume import TOOL_MM, Field, volume_section


def drawn(machine, *fields):
    """The traces of each panel."""
    (section,) = volume_section(machine, fields)
    return section, [panel.traces for panel in section.figure().panels]


@pytest.mark.parametrize("name", ["gantry", "cframe", "dmu50", "head_table"])
def test_cones_are_the_exact_errors_relative_to_the_centre(name):
    machine = load(name)
    model = random_model(machine, 3)
    section, ((cones,), slices) = drawn(machine, Field("before", model))
    assert len(slices) == 3
    linear = [i for i in range(len(machine.axes)) if not machine.rotary[i]]
    q = np.tile(np.array([axis.home for axis in machine.axes]) * machine.scale, (2, 1))
    q[0, linear], q[1, linear] = machine.travel[0, linear], machine.travel[:, linear].mean(axis=0)
    first, centre = exact_deviation(machine, q, model.errors(machine, State(q)), (0.0, 0.0, -TOOL_MM)).position * 1e3
    found = np.array([cones[k][0] for k in "uvw"])
    np.testing.assert_allclose(found, first - centre, atol=1e-6)
    size = np.linalg.norm([cones[k] for k in "uvw"], axis=0)
    assert (
        f"Before: {np.sqrt(np.mean(size**2)):.2f} um RMS, at most {size.max():.2f} um, relative to the centre of the volume."
        in section.text
    )
    most = max(size.max(), *(surface["surfacecolor"].max() for surface in slices))
    assert section.figure().colours["cmax"] == pytest.approx(most)


def test_a_correction_by_the_same_model_leaves_nothing_but_the_uncertainty():
    machine = load("gantry")
    model = random_model(machine, 3)
    sure = msgspec.structs.replace(model, covariance=tuple(map(tuple, np.eye(len(model.parameters)).tolist())))
    section, panels = drawn(
        machine, Field("before", model), Field("after", model, model), Field("U", sure, uncertain=True)
    )
    assert len(panels) == 4
    assert "After: 0.00 um RMS" in section.text
    assert all(surface["surfacecolor"].max() > 0.1 for surface in panels[-1])
    centre = panels[-1][0]["surfacecolor"]
    assert centre[centre.shape[0] // 2, centre.shape[1] // 2] == pytest.approx(0.0, abs=1e-9)


def test_effects_of_time_are_left_out():
    machine = load("cframe")
    effects = (Backlash("X", 20.0), ThermalDrift(component="Z", rate=50.0))
    model = msgspec.structs.replace(no_errors(machine), effects=effects)
    section, panels = drawn(machine, Field("before", model))
    assert "leave out effects of time" in section.text
    assert all(surface["surfacecolor"].max() == 0.0 for surface in panels[0])


def test_every_kind_of_effect_has_its_origin_and_its_repair():
    assert set(WORKSHOP) == {effect.__struct_config__.tag for effect in EFFECTS}
    assert all(text.endswith(".") for each in WORKSHOP.values() for text in each)
