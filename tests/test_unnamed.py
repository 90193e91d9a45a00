"""What no cause explains, added without a name: only where it predicts, and beside what the model can hold."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.residual.unnamed import OWN, evidence, surviving, terms_of
from calibration.reports.diagnosis_json import diagnosis_json
from support.command import refusal
from support.tiers import quick
from virtual_machine import draws, observe

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.evaluation.volumetric import volumetric_error_um
from calibration.measurement.file import read_measurement
from kinematics.deviation import exact_deviation
from kinematics.effects import Unnamed
from kinematics.forward import tool_point


def read(text, name, folder):
    (folder / "data.csv").write_text(text, encoding="utf-8")
    return read_measurement(folder / "data.csv", machines.load(name))


def test_terms_hold_what_a_function_of_these_lengths_does():
    rng, at = np.random.default_rng(1), np.linspace(0.0, 1.0, 40)
    terms, spread = terms_of((0.3, 0.7), 200)
    columns = np.polynomial.legendre.legvander2d(*(2 * np.array(np.meshgrid(at, at)) - 1), [24, 24]).reshape(
        1600, 25, 25
    )
    columns = columns[:, terms[:, 0], terms[:, 1]]
    assert np.mean(np.sum((columns * spread) ** 2, axis=1)) == pytest.approx(1.0, abs=0.1)
    kernels = [np.exp(-0.5 * ((at[:, None] - at) / length) ** 2) for length in (0.3, 0.7)]
    roots = [np.linalg.cholesky(kernel + 1e-9 * np.eye(40)) for kernel in kernels]
    drawn = np.einsum("ai,ij,bj->ba", roots[0], rng.normal(size=(40, 40)), roots[1]).reshape(-1)
    size = np.linalg.lstsq(columns, drawn, rcond=None)[0]
    assert np.std(drawn - columns @ size) < 0.1 * np.std(drawn)
    assert len(terms_of((0.3, 0.7), 5)[0]) == 5


@pytest.mark.parametrize("lengths", [(1.1, 0.7, 1.1), (1.1, 1.1, 1.1), (0.7, 0.7, 1.1)])
def test_a_function_of_three_variables_depends_on_all_three(lengths):
    """Nearly all variance of a very smooth one is in terms of two variables, which models hold more easily."""
    assert (1, 1, 1) in map(tuple, terms_of(lengths, 120)[0].tolist())


def test_of_every_combination_of_what_is_kept_enough_survives():
    rng = np.random.default_rng(2)
    model = np.linalg.qr(rng.normal(size=(200, 20)))[0]
    columns = rng.normal(size=(200, 12))
    columns[:, 3] = model[:, 0] * 9.0  # the model holds it all
    columns[:, 7] = columns[:, 5] + 9.0 * model[:, 1]
    left = columns - model @ (model.T @ columns)
    whole, own = columns.T @ columns, left.T @ left
    kept = surviving(whole, own)
    assert {3, 7}.isdisjoint(kept.tolist())
    assert len(kept) >= 9
    for size in rng.normal(size=(200, len(kept))):
        assert size @ own[np.ix_(kept, kept)] @ size >= 0.99 * OWN * (size @ whole[np.ix_(kept, kept)] @ size)


def test_evidence_tells_a_function_from_noise_and_how_large_it_is():
    rng = np.random.default_rng(3)
    columns, noise = rng.normal(size=(400, 15)), rng.normal(size=400)
    signal = columns @ rng.normal(0.0, 0.5, 15)
    assert evidence(columns.T @ columns, columns.T @ noise)[0] < 3.0
    odds, size = evidence(columns.T @ columns, columns.T @ (signal + noise))
    assert odds > 100.0
    assert 0.3 < size < 0.8


def test_what_to_do_with_what_is_left_is_one_of_two(tmp_path):
    (tmp_path / "data.csv").write_text("", encoding="utf-8")
    words = ["diagnose", str(tmp_path / "data.csv"), "-m", "cframe", "-o", str(tmp_path / "n.json")]
    assert "--unexplained drop: expected report or add" in refusal(*words, "--unexplained", "drop")
    assert not (tmp_path / "n.json").exists()


def elsewhere(draw, seed):
    """The same times at positions that were not measured."""
    session = draw.setup.session
    low, high = np.array([axis.travel for axis in session.chain.axes]).T
    positions = np.random.default_rng(seed).uniform(low, high, session.positions.shape).round(3)
    return replace(draw, setup=replace(draw.setup, session=replace(session, positions=positions)))


def missed_um(model, draw, causes, folder):
    """RMS length of what a model says of the tool less the truth, after alignment."""
    there = elsewhere(draw, 5)
    measured = read(there.sheet(), draw.setup.session.chain.name, folder)
    machine, state = measured.machine, measured.state
    said = exact_deviation(machine, state.positions, model.errors(machine, state), measured.tool).position
    true = observe.exact_points(there.setup.having(*causes)) - there.setup.session.points()
    return volumetric_error_um(said - true, tool_point(machine, state.positions, measured.tool)).rms


@pytest.mark.parametrize("seed", quick([0, 1], [], [0]))
def test_what_no_cause_explains_is_predicted_and_leaves_the_machine_alone(seed, tmp_path):
    draw = draws.unknown("cframe", seed)
    measurement = read(draw.sheet(), "cframe", tmp_path)
    told, found = diagnose(measurement), diagnose(measurement, left_over="add")
    assert [cause.kind for cause in found.causes if isinstance(cause.effect, Unnamed)] == ["unnamed"]
    (own,) = (cause for cause in found.causes if isinstance(cause.effect, Unnamed))
    assert own.effect.component == draw.causes[0].component
    assert own.heldout_gain_um > 0.2 * told.after.held_out_um
    assert own.effect.name in {effect.name for effect in found.model.effects}
    said = diagnosis_json(found)
    assert set(said["unexplained"]["variables"]) == {"X", "Z", "time"}
    assert "unnamed" in {effect["kind"] for effect in said["effects"]}
    assert found.after.fit.rms_um < 1.15 * found.noise_um
    assert found.after.held_out_um < told.after.held_out_um
    assert missed_um(found.model, draw, draw.causes, tmp_path) < 0.8 * missed_um(
        told.model, draw, draw.causes, tmp_path
    )
    # in the one the effect is a function of its own, in the other it is noise of the axis along which it acts
    machine = found.model.part(lambda effect: not isinstance(effect, Unnamed))
    for model in (machine, told.model):
        assert missed_um(model, draw, (), tmp_path) < 0.15 * draw.causes[0].size


@pytest.mark.statistical
def test_where_nothing_is_left_nothing_is_added(tmp_path):
    measurement = read(draws.nothing(1).sheet(), "cframe", tmp_path)
    told, found = diagnose(measurement), diagnose(measurement, left_over="add")
    assert found.unnamed == ""
    assert found.after is found.named
    assert found.model.effects == told.model.effects
    assert found.model.covariance == told.model.covariance
