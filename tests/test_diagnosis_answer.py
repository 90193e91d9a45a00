"""`ncomp diagnose`: causes with sizes, ties, the calibration, contract 4.3, and what is refused."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from support.command import refusal, run_command
from support.virtual_measurements import THREE, measured, positions
from virtual_machine import draws

import machines
from calibration.measurement.written_file import write_measurement
from kinematics.effects import Cyclic
from kinematics.error_model.model import no_errors

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from short_measurements.answers import predicted, rms, without_rigid
from short_measurements.case import UM, Case
from short_measurements.machines import AXES

CFRAME = machines.load("cframe")
FIGURES = {"rms_um", "max_um", "chi2_reduced", "heldout_rms_um"}
KEYS = {
    *("before", "after", "noise_um", "n_observations", "n_parameters", "rank", "not_visible", "accepted", "reason"),
    *("effects", "unexplained", "next_measurement", "estimated_noise"),
}
OF_EFFECT = {
    *("kind", "where", "axis", "parameters", "u", "log10_odds", "heldout_gain_um", "share", "verdict", "alternatives"),
}
BACKLASH = Case("cframe", "pairs", "backlash", 5)
NOTHING = Case("gantry", "layers", "none", 5)


class Told(NamedTuple):
    """What the command wrote."""

    document: dict[str, Any]
    calibration: Path
    shown: str


def diagnose(folder: Path, machine: str, *options: str) -> Told:
    """The diagnosis of `data.csv` in a folder."""
    new, out = folder / "new.json", folder / "out.json"
    words = ("-m", machine, "-o", new, "--json", out, *options)
    done = run_command("diagnose", folder / "data.csv", *words)
    assert done.status == 0, done.shown
    return Told(json.loads(out.read_text(encoding="utf-8"), parse_constant=pytest.fail), new, done.shown)


@pytest.fixture(scope="module")
def answer(tmp_path_factory) -> Callable[[Case], Told]:
    """The diagnosis of a case, made once."""
    known: dict[str, Told] = {}

    def ask(case: Case) -> Told:
        if case.name not in known:
            folder = tmp_path_factory.mktemp("case")
            case.write(folder)
            known[case.name] = diagnose(folder, case.machine)
        return known[case.name]

    return ask


def test_a_backlash_is_named_with_its_size(answer):
    (cause,) = answer(BACKLASH).document["effects"]
    assert (cause["kind"], cause["where"], cause["axis"]) == ("backlash", "machine", AXES[BACKLASH.axis])
    assert cause["verdict"] == "strong"
    assert cause["log10_odds"] > 2.0
    assert abs(cause["parameters"]["width_um"] - BACKLASH.size / UM) <= 2.0 * cause["u"]["width_um"]


def test_nothing_hidden_gives_no_cause(answer):
    found, _, shown = answer(NOTHING)
    assert found["effects"] == []
    assert "No cause was found: residual" in " ".join(shown.split())
    assert found["unexplained"] is None
    assert found["accepted"]


@pytest.mark.parametrize(
    "case", [BACKLASH, pytest.param(NOTHING, marks=pytest.mark.statistical)], ids=lambda case: case.effect
)
def test_the_calibration_predicts_unseen_poses_within_its_intervals(answer, tmp_path, case):
    states = case.unseen()
    nominal = case.nominal(states)
    true = without_rigid(nominal, (case.points(states, unseen=True) - nominal) / UM)
    case.write(tmp_path)
    record = predicted(case, answer(case).calibration, tmp_path, nominal, true)
    assert record["after_um"] < 0.5 * rms(true)
    assert record["covered"] > 0.85


def test_the_document_has_the_keys_of_the_contract(answer):
    found = answer(BACKLASH).document
    assert set(found) >= KEYS
    assert set(found["before"]) == set(found["after"]) == FIGURES
    for effect in found["effects"]:
        assert set(effect) >= OF_EFFECT
        assert 0.0 < effect["share"] <= 1.0
    assert found["n_observations"] == 3 * len(BACKLASH.rows.q)
    assert found["after"]["heldout_rms_um"] < found["before"]["heldout_rms_um"]
    assert 0.0 < found["noise_um"] < found["before"]["rms_um"]


def test_a_wave_of_few_periods_over_the_travel_is_an_error_motion(tmp_path):
    """The axis has it whatever its drive: the calibration holds it, and it is no cause."""
    (low, high), rng = CFRAME.axes[CFRAME.index("X")].travel, np.random.default_rng(5)
    wave = Cyclic("X", "X", (high - low) / 2.5, (5.0,), (1.7,))
    model = msgspec.structs.replace(no_errors(CFRAME), effects=(wave,))
    with (tmp_path / "data.csv").open("wb") as file:
        write_measurement(measured(CFRAME, positions(CFRAME, 200, rng), THREE, model, rng), file)
    found = diagnose(tmp_path, "cframe", "--force").document
    assert found["effects"] == []
    assert found["unexplained"] is None


def test_effects_of_the_instrument_are_named_and_not_written(tmp_path):
    case = Case("cframe", "pairs", "station drift", 7)
    case.write(tmp_path)
    found = diagnose(tmp_path, "cframe")
    assert [(each["kind"], each["where"]) for each in found.document["effects"]] == [("tracker-drift", "instrument")]
    kinds = {each["kind"] for each in json.loads(found.calibration.read_text(encoding="utf-8"))["effects"]}
    assert "tracker-drift" not in kinds


@pytest.fixture
def data(tmp_path):
    """A measurement file."""
    NOTHING.write(tmp_path)
    return tmp_path / "data.csv"


def test_an_interferometer_has_the_same_answer(tmp_path):
    (tmp_path / "data.csv").write_text(draws.by_laser("backlash", "cframe", 1).sheet(), encoding="utf-8")
    found = diagnose(tmp_path, "cframe").document
    assert {each["kind"] for each in found["effects"]} == {"backlash"}
    assert found["accepted"]


def test_data_of_a_calibration_count_once(answer, tmp_path):
    NOTHING.write(tmp_path)
    found = diagnose(tmp_path, "gantry", "--calibration", answer(NOTHING).calibration).document
    assert "the calibration was made from these data" in found["sanity"][0]["says"]
    assert not found["confirmed"]


def test_few_rows_are_refused(data, tmp_path):
    lines = data.read_text(encoding="utf-8").splitlines()
    head = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    data.write_text("\n".join(lines[: head + 13]) + "\n", encoding="utf-8")
    message = refusal("diagnose", data, "-m", "gantry", "-o", tmp_path / "new.json")
    assert "too few" in message
    assert not (tmp_path / "new.json").exists()


def test_a_result_that_predicts_worse_than_no_model_is_not_written(data, tmp_path):
    """Readings that belong to other positions."""
    lines = data.read_text(encoding="utf-8").splitlines()
    head = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    rows = [line.split(",") for line in lines[head:]]
    noise = np.random.default_rng(3).normal(0.0, 0.3, (len(rows), 3))
    at = lines[head - 1].split(",").index("x")
    for row, shift in zip(rows, noise, strict=True):
        row[at : at + 3] = [f"{float(cell) + moved:.5f}" for cell, moved in zip(row[at : at + 3], shift, strict=True)]
    data.write_text("\n".join([*lines[:head], *map(",".join, rows)]) + "\n", encoding="utf-8")
    new, out = tmp_path / "new.json", tmp_path / "out.json"
    words = ("diagnose", data, "-m", "gantry", "-o", new, "--json", out)
    assert "worse" in refusal(*words)
    assert not new.exists()
    assert not json.loads(out.read_text(encoding="utf-8"))["accepted"]
    assert run_command(*words, "--force").status == 0
    assert new.exists()
