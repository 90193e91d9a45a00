"""Calibration on the fly, on the fixed set-up: 600 x 600 x 450 mm, chain Y-X-Z, one target 100 mm below the nose.

    python benchmarks/on_the_fly.py [paths] [standstill] [many] [five-axes] [--draws 6]

paths: error on the path and on a grid, before and after, for the on-the-fly paper's diagonals and for the path that
`ncomp plan path` makes; 18 error motions of a straight line and two waves each (half a period to
two), so large that the mean deviation on the grid is 103 um; a reading every 4 mm, at random inside its step; pose
unknown. Grid points are never on the path. standstill: the same virtual machine calibrated by points at rest and on
the fly. many: half a million readings from a file to a calibration. five-axes: all axes of a DMU 50 along one path.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

import machines
from calibration.evaluation.volumetric import aligned, deviation_on, volumetric_error_um
from calibration.fit.calibrate import calibrate
from calibration.fit.fit import fit
from calibration.fit.identifiability import identifiability
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.observation.full_model import BasisChoice, with_effects
from calibration.observation.normal_equations import residuals
from calibration.on_the_fly.along_path import CELL_MM, CORNER_MM, on_path
from calibration.on_the_fly.corrected_positions import with_corrected_positions
from calibration.on_the_fly.drive import PathDynamics
from calibration.on_the_fly.nominal_path import NominalPath, target_path
from calibration.on_the_fly.planning.noise_gain import Volume
from calibration.on_the_fly.planning.path_search import best_path
from calibration.on_the_fly.planning.unidentifiable_mode import common_odd_mode
from calibration.on_the_fly.readings import Readings
from calibration.on_the_fly.virtual import Session, readings_of, write_readings
from calibration.planning.strategies import evaluation_grid, plan
from calibration.simulation.simulate import observe, tracker_pose
from calibration.simulation.true_model import model_of, random_true_model
from kinematics.basis import Fourier
from kinematics.effects import COMPONENTS, ErrorMotion
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

MACHINE = """
name = "fixed"
chain = "w b Y X Z t"
axes.X = { travel = [0, 600] }
axes.Y = { travel = [0, 600] }
axes.Z = { travel = [0, 450] }
"""
TOOL = (0.0, 0.0, -100.0)
TARGETS = {"t": Target(TOOL)}
AT = (-1500.0, -300.0, 200.0)
GRID_UM, LENGTH_MM, FEED = 103.0, 21_000.0, 2500.0
Curves = dict[str, tuple[Array, Array]]
"""Values and standard uncertainties of error motions at positions, by name."""
NODES = {"X": BasisChoice("b-spline", 13), "Y": BasisChoice("b-spline", 13), "Z": BasisChoice("b-spline", 10)}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", default=[], help="paths, standstill, many, five-axes; all without")
    parser.add_argument("--draws", type=int, default=6)
    arguments = parser.parse_args()
    parts: dict[str, Callable[[], None]] = {
        "paths": lambda: paths(arguments.draws),
        "standstill": lambda: standstill(arguments.draws),
        "many": many,
        "five-axes": five_axes,
    }
    for name in arguments.what or parts:
        parts[name]()


# ---- paths


def paths(draws: int) -> None:
    """Both paths, without noise and with 1 um."""
    machine = machines.parse(MACHINE, "fixed")
    volume = Volume(machine, machine.travel, TARGETS, CELL_MM, CORNER_MM)
    start = time.perf_counter()
    best = best_path(volume, LENGTH_MM, np.random.default_rng(0))
    spent = time.perf_counter() - start
    choices = {"face and space diagonals": _diagonals(machine), "planned": _path(machine, best.corners)}
    print(f"planned in {spent:.1f} s")
    for name, path in choices.items():
        moves = zip(path.positions[:-1], path.positions[1:], path.feed_move[1:], strict=True)
        found = volume.noise_gain(np.sum([volume.information(a, b) for a, b, counts in moves if counts], axis=0))
        feeds = np.diff(path.feed_distance)[path.feed_move[1:]].sum() * 1e-3
        print(f"{name}: {feeds:.2f} m, noise gain {found.noise:.3f} (worst {found.worst:.2f}), {found.hidden} hidden")
        print(f"  {_hidden(path, machine)}")
        for noise in (0.0, 1.0):
            evaluated = np.array([_evaluated(path, machine, noise, draw) for draw in range(draws)])
            a, b, c, d = evaluated.mean(axis=0)
            print(
                f"  noise {noise:g} um: path {a:.1f} -> {b:.2f} um, grid {c:.1f} -> {d:.2f} um "
                f"(mean of {draws} machines, worst {evaluated[:, 3].max():.2f})",
                flush=True,
            )


def _evaluated(path: NominalPath, machine: Machine, noise: float, draw: int) -> tuple[float, float, float, float]:
    """Mean deviation across the path before and after, and on the grid before and after, um."""
    rng = np.random.default_rng([8, draw])
    truth = _truth(machine, rng)
    tracker = LaserTracker(u_range_um=noise or 0.02, u_angle_um=noise or 0.02)
    measurement = with_corrected_positions(on_path(_sparse(path, truth, tracker, noise > 0.0, rng), path))
    found = calibrate(measurement, hold_out=False)
    registration, _ = measurement.first_registration
    nominal = residuals(measurement, no_errors(machine), registration)
    before, after = (np.linalg.norm(each, axis=1).mean() * 1e3 for each in (nominal, found.fit.residual))
    return float(before), float(after), *_on_grid(machine, truth, found.model)


def _on_grid(machine: Machine, truth: ErrorModel, found: ErrorModel) -> tuple[float, float]:
    """Mean length of the deviations on the grid, aligned, of the true errors and of the errors after the fit, um."""
    grid = evaluation_grid(machine)
    wanted, points = deviation_on(machine, truth, grid, TOOL)
    got, _ = deviation_on(machine, found, grid, TOOL)
    own, left = (np.linalg.norm(aligned(d, points), axis=1).mean() * 1e3 for d in (wanted, got - wanted))
    return float(own), float(left)


def _truth(machine: Machine, rng: np.random.Generator) -> ErrorModel:
    """18 error motions of a straight line and two waves, scaled."""
    effects = []
    for axis in machine.axes:
        for component in COMPONENTS:
            waves = tuple(rng.uniform(1.0, 4.0, 2).tolist())
            phases = rng.uniform(0.0, 2.0 * np.pi, 2)
            sizes = rng.uniform(-1.0, 1.0, 3)
            parts = [(s * np.cos(p), s * np.sin(p)) for s, p in zip(sizes[1:], phases, strict=True)]
            values = (0.0, sizes[0], *(float(v) for pair in parts for v in pair))
            effects.append(ErrorMotion(component, axis.name, Fourier(axis.travel, waves), values))  # type: ignore[arg-type]
    drawn = model_of(machine, effects)
    own, points = deviation_on(machine, drawn, evaluation_grid(machine), TOOL)
    scale = GRID_UM / float(np.linalg.norm(aligned(own, points), axis=1).mean() * 1e3)
    return drawn.with_parameters(drawn.parameters * scale)


def _sparse(
    path: NominalPath, truth: ErrorModel, tracker: LaserTracker, noisy: bool, rng: np.random.Generator
) -> Readings:
    """A reading in every 4 mm of the path, at random inside its step, at constant feed."""
    way = target_path(path, TARGETS["t"])
    steps = int(way.length / 4.0)
    s = (np.arange(steps) + rng.uniform(0.02, 0.98, steps)) * way.length / steps
    state = State(way.positions_at(s), time=s / (FEED / 60.0))
    poses = {"1": tracker_pose(AT, rng)}
    seen = observe(path.machine, truth, state, tracker, rng, poses, TARGETS, noise_scale=float(noisy))
    return _as_read(seen, np.full(steps, "1"))


def _as_read(seen: Measurement, run: np.ndarray) -> Readings:
    state = seen.state
    assert state.time is not None
    assert state.target is not None
    assert state.station is not None
    return Readings(
        LaserTracker(**msgspec.structs.asdict(seen.instrument)), seen.targets, "workpiece", state.time, seen.observed,
        state.target, state.station, run, {}, np.arange(len(seen)), "virtual", "",
    )  # fmt: skip


def _hidden(path: NominalPath, machine: Machine) -> str:
    """Rank with a 50 mm table, and the blind mode by name."""
    rng = np.random.default_rng(0)
    tracker = LaserTracker(u_range_um=1.0, u_angle_um=1.0)
    measurement = on_path(_sparse(path, _truth(machine, rng), tracker, True, rng), path).measurement
    model, prior = with_effects(measurement, NODES, (), 200.0 / 30.0)
    found = fit(measurement, model, prior=prior)
    seen = identifiability(found)
    mode = common_odd_mode(measurement, found.registration)
    return f"rank {seen.rank_registered} with a 50 mm table; blind mode: {mode or 'none'}"


def _diagonals(machine: Machine) -> NominalPath:
    """Both diagonals of every face, then those of space; the connections, edges and face diagonals, count as well."""
    low, high = machine.travel[:, [machine.index(name) for name in "XYZ"]]
    places = []
    for moving in ((0, 1), (0, 2), (1, 2), (0, 1, 2)):
        for corner in np.ndindex(2, 2, 2):
            if corner[moving[0]] == 0:
                other = [1 - c if i in moving else c for i, c in enumerate(corner)]
                places += [low + np.array(corner) * (high - low), low + np.array(other) * (high - low)]
    q = np.zeros((len(places), 3))
    q[:, [machine.index(name) for name in "XYZ"]] = places
    return _path(machine, q[np.append(True, np.abs(np.diff(q, axis=0)).max(axis=1) > 0.0)])


def _path(machine: Machine, corners: Array) -> NominalPath:
    moves = np.diff(corners, axis=0)[:, ~machine.rotary]
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(moves, axis=1))])
    return NominalPath(machine, corners, way, np.ones(len(corners), bool), "path.nc")


# ---- at rest and on the fly


def standstill(draws: int) -> None:
    """The same machine by 320 points at rest and along the planned path: each error motion and the volume compared."""
    machine = machines.parse(MACHINE, "fixed")
    volume = Volume(machine, machine.travel, TARGETS, CELL_MM, CORNER_MM)
    path = _path(machine, best_path(volume, LENGTH_MM, np.random.default_rng(0)).corners)
    rows = np.array([_two_ways(machine, path, draw) for draw in range(draws)])
    chi2_rest, grid_rest, chi2_fly, grid_fly, *shares = rows.mean(axis=0).tolist()
    print(f"320 positions at rest with 3 targets, and on the fly, {draws} machines:")
    print(f"  at rest: {grid_rest:.2f} um left on the grid, chi2/dof {chi2_rest:.3f}")
    print(f"  on the fly: {grid_fly:.2f} um left on the grid, chi2/dof {chi2_fly:.3f}")
    agree, rest, fly = (100 * share for share in shares)
    print(f"  error motions within U (k=2) of each other at {agree:.1f} % of positions (by machine "
          f"{', '.join(f'{100 * share:.0f}' for share in rows[:, 4])})")  # fmt: skip
    print(f"  within U of the truth: at rest {rest:.1f} %, on the fly {fly:.1f} %")


def _two_ways(machine: Machine, path: NominalPath, draw: int) -> tuple[float, ...]:
    """chi2 and remaining um on the grid, at rest and on the fly; shares of positions within U: both, each of the true
    errors.
    """
    rng = np.random.default_rng([5, draw])
    truth = _truth(machine, rng)
    tracker = LaserTracker(u_range_um=0.5, u_angle_um=3.0, u_angle_um_per_m=1.0)
    poses = {"1": tracker_pose(AT, rng)}
    targets = {
        "a": Target(TOOL), "b": Target((90.0, 40.0, -160.0)), "c": Target((-60.0, 80.0, -120.0)),
    }  # fmt: skip
    at_rest = plan(machine, "hexahedron+random", (170, 150))
    n = len(at_rest.positions)
    state = with_moves(State(np.tile(at_rest.positions, (3, 1)), target=np.repeat(list(targets), n)))
    resting = calibrate(observe(machine, truth, state, tracker, rng, poses, targets), hold_out=False)
    session = Session(path, [PathDynamics(10_000.0, rate=100.0)], targets, poses)
    made = readings_of(session, truth, tracker, rng)
    taken = on_path(_as_read(made, np.full(len(made), "1")), path)
    moving = calibrate(with_corrected_positions(taken), hold_out=False)
    evaluated = [(each.fit.chi2_reduced, _on_grid(machine, truth, each.model)[1]) for each in (resting, moving)]
    rest, fly = _curves(resting.model, machine), _curves(moving.model, machine)
    exact = _curves(truth, machine)
    return (*evaluated[0], *evaluated[1], _agree(rest, fly), _agree(rest, exact), _agree(fly, exact))


def _agree(first: Curves, second: Curves) -> float:
    """Share of the positions along all axes where the error motions agree within U."""
    values, u = (np.concatenate([first[name][i] for name in first]) for i in (0, 1))
    others, u_other = (np.concatenate([second[name][i] for name in first]) for i in (0, 1))
    return float(np.mean(np.abs(values - others) < 2.0 * np.hypot(u, u_other)))


def _curves(model: ErrorModel, machine: Machine) -> Curves:
    """Error motions in the datum, without means and slopes, and their standard uncertainties, along the travel."""
    result = {}
    whole = np.array(model.covariance) if model.covariance else np.zeros((len(model.parameters),) * 2)
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, ErrorMotion):
            low, high = machine.axes[machine.index(effect.axis)].travel
            x = np.linspace(low + 10.0, high - 10.0, 41)
            line = np.stack([np.ones_like(x), x], axis=1)
            off = np.eye(len(x)) - line @ np.linalg.pinv(line)
            columns = off @ effect.basis.columns(x)
            u = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", columns, whole[part, part], columns), 0.0))
            result[effect.name] = columns @ np.array(effect.parameters), u
    return result


# ---- half a million readings, five axes


def many() -> None:
    """Half a million readings: the file, the command, its time and its memory."""
    machine = machines.parse(MACHINE, "fixed")
    rng = np.random.default_rng(6)
    volume = Volume(machine, machine.travel, TARGETS, CELL_MM, CORNER_MM)
    corners = best_path(volume, LENGTH_MM, np.random.default_rng(0)).corners
    path = _path(machine, corners)
    session = Session(path, [PathDynamics(FEED, rate=980.0)], TARGETS, {"1": tracker_pose(AT, rng)})
    tracker = LaserTracker(u_range_um=0.5, u_angle_um=3.0, u_angle_um_per_m=1.0)
    made = readings_of(session, _truth(machine, rng), tracker, rng)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "fixed.toml").write_text(MACHINE)
        words = [" ".join(f"{n}{v:.4f}" for n, v in zip(machine.names, q, strict=True)) for q in corners.tolist()]
        (place / "path.nc").write_text(
            "\n".join(["G21 G90 G94", *(f"G53 G1 {text} F{FEED}" for text in words), "M30", ""])
        )
        with (place / "points.csv").open("wb") as file:
            write_readings(made, file)
        size = (place / "points.csv").stat().st_size * 1e-6
        command = [
            sys.executable,
            "-c",
            "from postproc.cli import run; run()",
            "fit",
            "points.csv",
            "--path",
            "path.nc",
        ]
        start = time.perf_counter()
        subprocess.run([*command, "--machine", "fixed.toml", "-o", "cal.json"], cwd=place, check=True)
        spent = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"{len(made)} readings ({size:.0f} MB): {spent:.1f} s ({used.ru_utime:.1f} s of processor) from the file to "
        f"the calibration, {used.ru_maxrss / 1e3:.0f} MB"
    )


def five_axes() -> None:
    """All axes of a DMU 50 along one planned path, three targets."""
    machine = machines.load("dmu50")
    rng = np.random.default_rng(7)
    targets = {"a": Target(TOOL), "b": Target((90.0, 40.0, -180.0)), "c": Target((-60.0, 80.0, -130.0))}
    volume = Volume(machine, machine.travel, targets, CELL_MM, CORNER_MM)
    start = time.perf_counter()
    best = best_path(volume, 14_000.0, np.random.default_rng(0))
    spent = time.perf_counter() - start
    path = _path(machine, best.corners)
    truth = random_true_model(machine, rng)
    tracker = LaserTracker(u_range_um=0.5, u_angle_um=3.0, u_angle_um_per_m=1.0)
    session = Session(path, [PathDynamics(3000.0, rate=100.0)], targets, {"1": tracker_pose(AT, rng)})
    made = readings_of(session, truth, tracker, rng)
    taken = on_path(_as_read(made, np.full(len(made), "1")), path)
    found = calibrate(with_corrected_positions(taken), hold_out=False)
    places = rng.uniform(*machine.travel, (2000, 5))
    wanted, points = deviation_on(machine, truth, places, TOOL)
    got, _ = deviation_on(machine, found.model, places, TOOL)
    before, after = (volumetric_error_um(each, points) for each in (wanted, got - wanted))
    print(
        f"dmu50, {best.length_mm * 1e-3:.1f} m in {spent:.0f} s, noise gain {best.noise_gain.noise:.3f}: "
        f"{taken.reduction}"
    )
    print(
        f"  all over the volume {before.rms:.1f} -> {after.rms:.2f} um RMS (largest {before.largest:.1f} -> "
        f"{after.largest:.1f}), chi2/dof {found.fit.chi2_reduced:.3f}"
    )


if __name__ == "__main__":
    main()
