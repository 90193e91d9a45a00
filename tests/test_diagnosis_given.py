"""A calibration that is given: it is confirmed, or changes of the machine are named with their sizes."""

import json
from functools import cache

import numpy as np
import pytest
from support.command import run_command
from support.probe_cases import TIP, probed
from support.virtual_measurements import ONE, THREE, measured, positions, truth, written

import machines
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.diagnosis.diagnose import diagnose
from calibration.evaluation.volumetric import aligned
from calibration.fit.calibrate import calibrate
from calibration.gaussian_terms.geometry import root_of
from calibration.measurement.measurement import Measurement, with_moves
from calibration.simulation.true_model import model_of
from kinematics.basis import Legendre
from kinematics.deviation import exact_deviation
from kinematics.effects import Backlash, Effect, ErrorMotion, LocationError, Scale
from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.state import State

CFRAME, DMU50 = machines.load("cframe"), machines.load("dmu50")
Z = CFRAME.axes[CFRAME.index("Z")].travel
CHANGES: dict[str, tuple[Effect, ...]] = {
    "squareness": (LocationError("C", "Y", 80.0),),
    "backlash": (Backlash("X", 15.0),),
    "scale": (Scale("Y", 60.0),),
    "scale and backlash": (Scale("X", -80.0), Backlash("Z", 20.0)),
}


def real(machine, *more: Effect) -> ErrorModel:
    return model_of(machine, (*truth(machine, np.random.default_rng(5), 12.0).effects, *more))


def data_of(machine, seed: int, rows: int, *more: Effect) -> Measurement:
    rng = np.random.default_rng(seed)
    targets = THREE if machine is CFRAME else ONE
    return measured(machine, positions(machine, rows, rng), targets, real(machine, *more), rng)


@cache
def by_fit() -> ErrorModel:
    """The calibration that `ncomp fit` makes."""
    return calibrate(data_of(CFRAME, 1, 150), hold_out=False).model


@cache
def by_diagnosis() -> ErrorModel:
    """The calibration of a diagnosis."""
    return diagnose(data_of(CFRAME, 1, 150)).calibration


@cache
def against(*hidden: Effect) -> Diagnosis:
    """The diagnosis of a machine with further errors against that calibration."""
    return diagnose(data_of(CFRAME, 2, 120, *hidden), by_diagnosis())


def sizes(answer: Diagnosis) -> dict[str, float]:
    return {cause.effect.name: cause.effect.parameters[0] for cause in answer.causes}


def left(machine, model: ErrorModel, *more: Effect) -> float:
    """RMS error, mm, that a calibration leaves at positions that were not measured."""
    state = with_moves(State(positions(machine, 100, np.random.default_rng(77))))
    points = tool_point(machine, state.positions, TIP)
    true, told = (
        aligned(exact_deviation(machine, state.positions, each.errors(machine, state), TIP).position, points)
        for each in (real(machine, *more), model)
    )
    return float(np.sqrt(np.mean((true - told) ** 2)))


@pytest.mark.parametrize(
    "given",
    [pytest.param(by_fit, id="by fit"), pytest.param(by_diagnosis, id="by diagnosis", marks=pytest.mark.statistical)],
)
def test_the_same_machine_confirms_its_calibration_and_makes_it_surer(given):
    found = diagnose(data_of(CFRAME, 2, 120), given())
    assert found.confirmed
    assert found.accepted
    assert found.machine_change is not None
    assert not found.machine_change.significant
    assert left(CFRAME, found.calibration) < left(CFRAME, given())
    before, after = (np.linalg.norm(root_of(model)) for model in (given(), found.calibration))
    assert after < before


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_named_with_its_size(change):
    hidden = CHANGES[change]
    found = against(*hidden)
    assert not found.confirmed
    assert sizes(found) == {effect.name: pytest.approx(effect.parameters[0], rel=0.25) for effect in hidden}
    # the change is part of the new calibration, which is the better one
    assert left(CFRAME, found.calibration, *hidden) < 0.8 * left(CFRAME, by_diagnosis(), *hidden)
    names = [effect.name for effect in found.calibration.effects]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("change", [LocationError("C", "Y", 80.0), Scale("Y", 60.0)], ids=lambda each: each.name)
def test_a_changed_line_has_its_size_within_its_uncertainty(change):
    found = against(change).machine_change
    assert found is not None
    assert found.significant
    (line,) = found.changed
    (size,), (u,) = line.parameters, line.uncertainties
    assert line.name == change.name
    assert abs(size - change.parameters[0]) < 3.0 * u < 0.5 * change.parameters[0]


def test_without_a_calibration_nothing_has_changed():
    assert diagnose(data_of(CFRAME, 2, 120)).machine_change is None


def test_a_guide_that_bends_since_the_calibration():
    bent = ErrorMotion("X", "Z", Legendre(Z, 3), (0.0, 0.0, 15.0, 10.0))
    found = against(bent)
    (cause,) = found.causes
    assert (cause.kind, cause.effect.name) == ("error-motion", "E_XZ")
    assert found.machine_change is not None
    assert found.machine_change.significant
    assert left(CFRAME, found.calibration, bent) < 0.7 * left(CFRAME, by_diagnosis(), bent)


def test_a_backlash_of_the_calibration_that_has_grown():
    given = diagnose(data_of(CFRAME, 1, 150, Backlash("Y", 20.0))).calibration
    found = diagnose(data_of(CFRAME, 2, 120, Backlash("Y", 35.0)), given)
    assert sizes(found) == {"backlash Y": pytest.approx(15.0, abs=5.0)}
    (width,) = [effect.width for effect in found.calibration.effects if effect.name == "backlash Y"]
    assert width == pytest.approx(35.0, abs=4.0)
    (cause,) = found.causes
    assert cause.present is not None
    assert cause.present.parameters[0] == pytest.approx(20.0, abs=4.0)


@pytest.mark.statistical
def test_a_tilted_rotary_axis_seen_with_a_touch_probe():
    own = LocationError("X", "C", 40.0), LocationError("A", "C", 60.0)
    given = diagnose(probed("dmu50", 50, effects=own)[0]).calibration
    same = diagnose(probed("dmu50", 50, seed=1, effects=own)[0], given)
    assert same.confirmed
    tilted = own[0], LocationError("A", "C", 120.0)
    found = diagnose(probed("dmu50", 50, seed=1, effects=tilted)[0], given)
    assert sizes(found) == {"E_A0C": pytest.approx(60.0, rel=0.2)}


def test_the_command_confirms_a_calibration(tmp_path):
    for name, seed in (("first", 1), ("second", 2)):
        written(data_of(CFRAME, seed, 120), tmp_path / f"{name}.csv")
    words = ("--machine", "cframe")
    old, new, out = tmp_path / "old.json", tmp_path / "new.json", tmp_path / "out.json"
    assert run_command("diagnose", tmp_path / "first.csv", *words, "-o", old).status == 0
    done = run_command("diagnose", tmp_path / "second.csv", *words, "-c", old, "-o", new, "--json", out)
    assert done.status == 0, done.shown
    said = json.loads(out.read_text(encoding="utf-8"))
    assert said["confirmed"]
    assert not said["machine_change"]["significant"]
    assert {line["name"] for line in said["machine_change"]["lines"]} >= {"E_C0Y", "scale X"}
    assert "No change of the machine: " in " ".join(done.shown.split())
    assert new.exists()
