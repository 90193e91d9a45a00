"""A machine measured again: the same one gives nothing to name, a changed one is told in the words of ISO 230-1."""

from functools import cache

import msgspec
import numpy as np
import pytest
from shop_floor.question import ask, earlier
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.evaluation.machine_change import MachineChange
from calibration.evaluation.volumetric import aligned
from calibration.fit.calibrate import calibrate
from calibration.fit.written.merged import merged
from calibration.gaussian_terms.given.nested_bases import refined
from calibration.measurement.file import read_measurement
from calibration.reports.diagnosis.document import diagnosis_json
from calibration.reports.diagnosis.page import diagnosis_report
from calibration.reports.machine_change import change_sentences
from kinematics.basis import Legendre
from kinematics.effects import Backlash, ErrorMotion, LocationError, Scale
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.state import State

MACHINE = machines.load("cframe")
BACKLASH = Backlash("Y", 12.0)


def with_effects(model, *effects):
    return msgspec.structs.replace(model, effects=(*model.effects, *effects), covariance=None)


def seen(model, seed, n, machine=MACHINE):
    rng = np.random.default_rng(seed)
    return measured(machine, positions(machine, n, rng), THREE, model, rng)


def machine_with(*effects):
    return with_effects(truth(MACHINE, np.random.default_rng(0), 20.0), *effects)


@cache
def calibration(*before):
    """The calibration of the machine with the effects `before`."""
    first = seen(machine_with(*before), 1, 200)
    return calibrate(first, basis="b-spline:4", effects=[each.with_parameters((0.0,)) for each in before]).model


def again(now, *, before=(), n=120):
    """The diagnosis of the machine with effects `now` against its calibration with the effects `before`."""
    return diagnose(seen(machine_with(*now), 5, n), calibration(*before))


@pytest.mark.statistical
def test_the_same_machine_has_not_changed():
    found = again((BACKLASH,), before=(BACKLASH,))
    assert not found.causes
    assert found.accepted
    assert not found.machine_change.significant
    assert diagnosis_json(found)["machine_change"]["rms_um"] < 2.0 * found.machine_change.u_um
    assert "No change of the machine: " in diagnosis_report(found, "ncomp diagnose").verdict


def test_no_figure_where_nothing_moves_the_tool_point():
    """A rotary axis by interferometer, whose axis line goes through the tool point."""
    (sentence,) = change_sentences(MachineChange(0.0, 0.0, 0.0, (), ()))
    assert "no figure in um" in sentence


@pytest.mark.statistical
def test_targets_that_were_mounted_again_are_no_error_of_the_machine():
    """They have turned on the tool: the errors are known as well."""
    travel = MACHINE.axes[MACHINE.index("Z")].travel
    same, turned = again(()), again([ErrorMotion(about, "Z", Legendre(travel, 0), (250.0,)) for about in "AB"])
    assert not [cause.effect.name for cause in turned.causes if cause.where == "machine"]
    assert turned.accepted
    assert turned.figures[1].heldout_rms_um < 1.05 * same.figures[1].heldout_rms_um


@pytest.mark.statistical
def test_a_tilt_of_the_rotary_axis_that_carries_the_targets_has_its_size():
    """It turns the targets: no turn of these takes its place."""
    machine = machines.load("head_table")
    errors, tilt = truth(machine, np.random.default_rng(0), 20.0), LocationError("A", "B", 80.0)
    present = calibrate(seen(errors, 1, 300, machine), basis="b-spline:4").model
    found = diagnose(seen(with_effects(errors, tilt), 5, 200, machine), present)
    assert [(cause.kind, cause.axis) for cause in found.causes] == [("location", "B")]
    (line,) = found.machine_change.changed
    assert (line.name, line.parameters[0]) == ("E_A0B", pytest.approx(80.0, abs=3.0 * line.uncertainties[0]))


@pytest.mark.statistical
def test_scale_and_squareness_are_told_in_words_with_their_sizes():
    changes = Scale("Y", 60.0), LocationError("C", "Y", -50.0)
    found = again(changes)
    lines = {line.name: line for line in found.machine_change.changed}
    for change in changes:
        (size,), (u,) = lines[change.name].parameters, lines[change.name].uncertainties
        assert abs(size - change.parameters[0]) < 3.0 * u
        assert u < 15.0
    assert sorted((cause.kind, cause.axis) for cause in found.causes) == [("location", "Y"), ("scale", "Y")]
    assert found.figures[0].heldout_rms_um > found.figures[1].heldout_rms_um
    verdict = diagnosis_report(found, "ncomp diagnose").verdict
    assert "CHANGED since the present calibration: " in verdict
    assert "scale of Y +" in verdict
    assert "squareness of Y to X -" in verdict


@pytest.mark.xfail(strict=True, reason="what the model cannot do: merge bases of an error motion that are not nested")
@pytest.mark.statistical
def test_each_error_motion_stands_once_in_a_calibration_of_a_changed_machine():
    names = [effect.name for effect in again((Scale("Y", 60.0), LocationError("C", "Y", -50.0))).model.effects]
    assert len(set(names)) == len(names)


@pytest.mark.statistical
def test_a_backlash_that_has_grown_is_a_change_with_its_size_then_and_now():
    found = again((Backlash("Y", 30.0),), before=(BACKLASH,))
    (cause,) = found.causes
    assert (cause.kind, cause.axis) == ("backlash", "Y")
    assert cause.effect.width == pytest.approx(18.0, abs=1.5)
    assert cause.present.width == pytest.approx(12.0, abs=1.5)
    assert diagnosis_json(found)["effects"][0]["present"] == {"width_um": cause.present.width}
    assert "Change of backlash Y" in diagnosis_report(found, "ncomp diagnose").verdict
    (width,) = (effect.width for effect in found.model.effects if isinstance(effect, Backlash))
    assert width == pytest.approx(30.0, abs=1.0)


def test_what_was_added_to_a_calibration_is_one_error_motion_for_each_axis_and_component():
    rng = np.random.default_rng(3)
    present = calibrate(seen(machine_with(), 1, 120), basis="b-spline:4", hold_out=False).model
    motions = [effect for effect in present.effects if isinstance(effect, ErrorMotion)]
    added = [
        ErrorMotion(m.component, m.axis, basis := refined(m.basis), tuple(rng.normal(0.0, 3.0, basis.size)))
        for m in motions
    ]
    whole = with_effects(present, *added, Scale("X", 8.0), LocationError("C", "Y", 4.0))
    spread = rng.normal(size=(len(whole.parameters),) * 2)
    whole = whole.with_parameters(np.array(whole.parameters), spread @ spread.T)
    one = merged(MACHINE, whole, len(present.effects))
    names = [effect.name for effect in one.effects]
    assert len(set(names)) == len(names)
    assert not any(isinstance(effect, Scale) for effect in one.effects)
    assert {effect.basis.size for effect in one.effects if isinstance(effect, ErrorMotion)} == {7}
    low, high = np.array([next(m.basis.interval for m in motions if m.axis == axis) for axis in MACHINE.names]).T
    q = rng.uniform(low, high, (60, 3))
    tool = np.zeros(3)
    transform = error_transform_with_tool(MACHINE, q, tool)[:, :3]
    wanted, got = (model.design(MACHINE, State(q), transform) @ model.parameters for model in (whole, one))
    # directions of the gauge are known to some nm
    assert np.abs(aligned(got - wanted, tool_point(MACHINE, q, tool))).max() < 1e-5
    assert np.abs(wanted).max() > 0.02
    assert np.linalg.eigvalsh(np.array(one.covariance)).min() > -1e-6
    assert len(merged(MACHINE, present, len(present.effects)).effects) == len(present.effects)


@pytest.mark.exam
def test_a_collision_after_the_calibration_is_named(tmp_path):
    """A smooth function of time and positions explains most of the step; the calibration lets no error motion do so."""
    gantry = machines.load("gantry")

    def read(question):
        (tmp_path / "data.csv").write_text(question.sheet())
        return read_measurement(tmp_path / "data.csv", gantry)

    given = diagnose(read(earlier("gantry", 1, 72001))).model
    found = diagnose(read(ask("again", "crash", "gantry", 1, 72001)), given)
    assert [(cause.kind, cause.axis) for cause in found.causes] == [("location-jump", "Z")]
    assert found.accepted
