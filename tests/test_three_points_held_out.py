"""`three-points` is checked at held-out positions: a model that predicts worse than the nominal machine is refused.

Measurement files of a virtual DMU 50, spoiled or not, handed to the command.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.three_points_cases import SERIES, TARGETS, measured, model, random_effects, station
from support.tiers import quick

import machines
from calibration.measurement.measurement import Measurement, Target
from calibration.measurement.written_file import write_measurement
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

DMU50 = machines.load("dmu50")
AROUND = {
    "1": station((800.0, -850.0, -650.0), 0.4),
    "2": station((-800.0, 850.0, -650.0), 2.0),
    "3": station((850.0, 800.0, 950.0), -1.0),
    "4": station((-850.0, -800.0, 950.0), -2.0),
}


def session(seed: int, *, size: float = 6.0, axes: str = "XYZ") -> Measurement:
    """One round from each of four stations, with the tracker's noise."""
    effects = random_effects(seed, degree=2, axes=axes, size=size)
    return measured(DMU50, model(DMU50, effects), AROUND, axes=axes, rng=np.random.default_rng(seed))


def written(measurement: Measurement, folder: Path) -> None:
    with (folder / "data.csv").open("wb") as file:
        write_measurement(measurement, file)


def moved(measurement: Measurement, size_um: float, seed: int) -> Measurement:
    """Every position of every axis off by a shift of its own, the same in all rounds and of all targets."""
    rng = np.random.default_rng(seed)
    places, of = np.unique(np.round(measurement.state.positions, 6), axis=0, return_inverse=True)
    shift = 1e-3 * size_um * rng.standard_normal((len(places), 3))
    there: Array = measurement.observed.copy()
    for name, pose in AROUND.items():
        rows = measurement.groups == name
        there[rows] += shift[of.reshape(-1)[rows]] @ pose.rotation[0].T
    return replace(measurement, observed=there)


def rough(seed: int) -> Measurement:
    """What no curve through the positions predicts between them: errors of 40 um without any order."""
    return moved(session(seed, size=1.0), 40.0, seed)


def noise_only(seed: int) -> Measurement:
    return session(seed, size=0.0)


def swapped(seed: int) -> Measurement:
    """In one round of X the reflectors P and Q sat in each other's nest."""
    seen = session(seed)
    names = seen.state.target
    assert names is not None
    other = np.select([names == "P", names == "Q"], ["Q", "P"], names)
    x = DMU50.index("X")
    of_x = seen.state.positions[:, x] != 10.0
    return replace(seen, state=replace(seen.state, target=np.where(of_x & (seen.run == "2"), other, names)))


def shuffled(seed: int) -> Measurement:
    """The positions of Y were run in another order than the sheet has them."""
    seen = session(seed)
    y, q = DMU50.index("Y"), seen.state.positions.copy()
    order = np.random.default_rng(seed).permutation(SERIES["Y"])
    rows = np.isin(np.round(q[:, y], 6), SERIES["Y"]) & (q[:, y] != -20.0)
    q[rows, y] = order[np.searchsorted(SERIES["Y"], np.round(q[rows, y], 6))]
    return replace(seen, state=replace(seen.state, positions=q))


def another_machine(seed: int) -> Measurement:
    """Measured on a machine whose C turns in the opposite direction."""
    seen = session(seed, axes="XYZC")
    q = seen.state.positions * np.where(np.array(DMU50.names) == "C", -1.0, 1.0)
    return replace(seen, state=replace(seen.state, positions=q))


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.statistical)])
@pytest.mark.parametrize("spoil", quick([rough, noise_only, swapped, shuffled, another_machine], [noise_only, swapped]))
def test_data_that_predict_nothing_are_refused(command, tmp_path: Path, spoil: Callable[[int], Measurement], seed: int):
    written(spoil(seed), tmp_path)
    done = command("three-points", "data.csv", "-m", "dmu50", "-o", "cal.json", "--json", "out.json")
    assert done.status == 2, done.err
    assert "Traceback" not in done.err
    assert "data.csv" in done.err
    assert not (tmp_path / "cal.json").exists()
    assert not (tmp_path / "out.json").exists()


def few_positions(monkeypatch) -> None:
    """Five positions of each axis."""
    for axis in "XYZ":
        monkeypatch.setitem(SERIES, axis, np.linspace(SERIES[axis].min(), SERIES[axis].max(), 5))


def test_a_table_through_errors_without_order_is_refused_by_what_is_held_out(command, tmp_path: Path, monkeypatch):
    """A table holds every position to the noise, so that no uncertainty shows it."""
    few_positions(monkeypatch)
    written(rough(3), tmp_path)
    done = command("three-points", "data.csv", "-m", "dmu50", "-o", "cal.json", "--basis", "table")
    assert done.status == 2
    assert "predicts held-out positions worse" in " ".join(done.err.split())


def guessed(measurement: Measurement) -> Measurement:
    """Targets whose positions were measured with a ruler."""
    rng = np.random.default_rng(0)
    sizes = {"tool": 0.5, "table": 10.0, "bed": 10.0}
    return replace(
        measurement,
        targets={
            name: Target(tuple((np.array(t.position) + rng.normal(0.0, sizes[t.carrier], 3)).tolist()), t.carrier)
            for name, t in TARGETS.items()
        },
    )


@pytest.mark.parametrize(
    "kind",
    quick(["linear", "sparse", "table", "five axes", "ruler"], ["sparse"]),
)
def test_good_data_pass_and_the_figures_say_how_well(command, tmp_path: Path, monkeypatch, kind: str):
    if kind == "sparse":
        few_positions(monkeypatch)
    seen = session(4, axes="XYZBC" if kind in ("five axes", "ruler") else "XYZ")
    written(guessed(seen) if kind == "ruler" else seen, tmp_path)
    basis = ("--basis", "table") if kind == "table" else ()
    done = command("three-points", "data.csv", "-m", "dmu50", "-o", "cal.json", "--json", "out.json", *basis)
    assert done.status == 0, done.err
    assert b"held out (" in done.out
    figures = json.loads((tmp_path / "out.json").read_text())
    noise = figures["after"]["rms_um"]
    assert noise < figures["after"]["heldout_rms_um"] < 2.0 * noise
    assert figures["after"]["heldout_rms_um"] < figures["before"]["heldout_rms_um"]


@pytest.mark.statistical
def test_a_turn_stays_closed_while_a_position_is_left_out(command, tmp_path: Path):
    seen: ErrorModel = model(DMU50, random_effects(7, degree=3, axes="C", size=8.0))
    written(measured(DMU50, seen, AROUND, axes="XYZC", rng=np.random.default_rng(4)), tmp_path)
    done = command("three-points", "data.csv", "-m", "dmu50", "-o", "cal.json", "--json", "out.json")
    assert done.status == 0, done.err
    after = json.loads((tmp_path / "out.json").read_text())["after"]
    assert after["heldout_rms_um"] < 1.2 * after["rms_um"]
