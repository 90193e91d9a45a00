"""The thesis' DMU 50 calibrated, compensated and verified, on virtual machines: `python benchmarks/thesis.py [DRAWS]`.

Ellingsdalen (NTNU 2021) measured three reflectors on the spindle in turn, 11 positions an axis, four rounds, with a
Leica AT960, compensated the translations of the linear axes, and measured again: E_XX 20.6 -> 10.4 um, E_YY 40.8 -> 10,
E_YX 6.6 -> 1.3, E_ZZ slightly worse at its peak, E_XY and E_ZY worse.

Every draw is another machine and other noise. The error motions are polynomials of the thesis' degrees, drawn at
random, scaled to the peaks that it quotes; other peaks are marked chosen in PEAKS. AT960: 15 um + 6 um/m across
the beam and 0.4 um + 0.3 um/m along it are maximum permissible errors; half of each is taken as standard uncertainty.
The linear axes are measured and compensated PASSES times, four rounds each, then verified; the published procedure
does it once. Errors are those of the spindle nose along the three lines through X0 Y0 Z0, zero at the first position,
in the frame that the first measurement set. True: without noise. Measured: on one more measurement with noise of its
own, from the same stations; six reflectors on the bed, the datums of all, keep the frame. Above noise: a peak beyond
twice its standard uncertainty; 80 %: of those, the draws that lose that much (true). A measured 0.00 is a curve in
which the data show nothing.
"""

from __future__ import annotations

import datetime
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace

import msgspec
import numpy as np

import machines
from benchmarks import thesis_procedure
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.registration.registration import Registration, rigid
from calibration.single_axis.three_points import identify
from kinematics.basis import Polynomial
from kinematics.correction import correct_position
from kinematics.deviation import exact_deviation
from kinematics.effects import Component, Effect, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, Observation
from kinematics.error_model.provenance import Provenance, reference
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import forward, tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import IDENTITY, Array, Pose, by_turn, rotation_vector_matrix

SEED = 20210611
AT960 = LaserTracker(u_range_um=0.2, u_range_um_per_m=0.15, u_angle_um=7.5, u_angle_um_per_m=3.0)
ROUNDS = 4
PASSES = 3
"""Times that the machine is measured and compensated, four rounds each, before it is verified."""
COMPONENTS: tuple[Component, ...] = ("X", "Y", "Z", "A", "B", "C")
SERIES = {
    "X": np.linspace(-250.0, 250.0, 11),
    "Y": np.linspace(-225.0, 225.0, 11),
    "Z": np.linspace(400.0, 0.0, 11),
    "C": np.arange(0.0, 360.0, 20.0),
    "B": np.arange(0.0, 181.0, 10.0),
}
PEAKS = {
    # quoted: XX YX YY ZZ; ZX of Fig. 3.11; XY "just over 5"; XZ YZ "about half" of ZZ; chosen: ZY and all angles
    "X": (20.6, 6.6, 2.9, 12.0, 15.0, 12.0),
    "Y": (5.2, 40.8, 5.0, 12.0, 10.0, 12.0),
    "Z": (8.0, 8.0, 16.5, 15.0, 10.0, 8.0),
    # chosen, after the look of Figs. 4.7-4.10
    "B": (4.0, 5.0, 6.0, 6.0, 8.0, 6.0),
    "C": (5.0, 5.0, 9.0, 20.0, 12.0, 12.0),
}
DEGREES = {
    "X": (4, 5, 8, 3, 3, 3),
    "Y": (8, 6, 4, 3, 3, 3),
    "Z": (4, 4, 8, 3, 3, 3),
    "B": (4, 4, 8, 7, 7, 7),
    "C": (8, 8, 8, 7, 7, 7),
}
LOCATIONS: tuple[tuple[Component, str, float], ...] = (
    ("X", "C", 6.0), ("Y", "C", -8.0), ("A", "C", 10.0), ("B", "C", -7.0),
    ("X", "B", 5.0), ("Z", "B", -6.0), ("A", "B", 9.0), ("C", "B", -12.0),
)  # fmt: skip
TARGETS = {
    "P": Target((95.0, 20.0, -80.0)),
    "Q": Target((-65.0, 75.0, 0.0)),
    "K": Target((-40.0, -85.0, 80.0)),
    "TP": Target((179.0, 20.0, 20.0), "table"),
    "TQ": Target((-90.0, 140.0, 60.0), "table"),
    "TK": Target((-80.0, -130.0, 110.0), "table"),
    "D1": Target((500.0, -450.0, -100.0), "bed"),
    "D2": Target((-500.0, -450.0, 500.0), "bed"),
    "D3": Target((-500.0, 450.0, -100.0), "bed"),
    "D4": Target((500.0, 450.0, 500.0), "bed"),
    "D5": Target((0.0, -500.0, 250.0), "bed"),
    "D6": Target((0.0, 500.0, 100.0), "bed"),
}
FRONT = {"1": (100.0, -1500.0, 300.0)}
"""As in the thesis: Y errors along the beam."""
AROUND = {
    "1": (800.0, -850.0, -650.0),
    "2": (-800.0, 850.0, -650.0),
    "3": (850.0, 800.0, 950.0),
    "4": (-850.0, -800.0, 950.0),
}
"""One round from each: two low, two high, so that the beams cross at large angles. Sight is taken to be free."""
ERRORS = [f"{component}{axis}" for axis in "XYZ" for component in "XYZ"]


@dataclass(frozen=True)
class Plan:
    """Position of the tracker in each round."""

    title: str
    eyes: Mapping[str, tuple[float, float, float]]


PLANS = (Plan("four stations", AROUND), Plan("one station", FRONT))


@dataclass(frozen=True)
class Outcome:
    """One procedure on one machine; um, by name of the error motion."""

    before: Mapping[str, float]
    u: Mapping[str, float]
    """Standard uncertainty of the measured error at its peak."""
    after: Mapping[str, float]
    """True."""
    measured: Mapping[str, float]
    """On the second measurement; empty for the thesis."""
    volume: tuple[float, float] = (0.0, 0.0)
    """RMS deviation at random positions of all five axes, before and after, table clamped as it is best."""


def main(draws: int) -> None:
    """Print the tables."""
    machine = machines.load("dmu50")
    outcomes: dict[str, list[Outcome]] = {}
    for draw in range(draws):
        rng = np.random.default_rng([SEED, draw])
        truth = virtual_machine(machine, rng)
        for plan in PLANS:
            poses = _poses(plan.eyes, rng)
            first = _measure(machine, truth, poses, rng)
            outcomes.setdefault(f"ncomp, {plan.title}", []).append(_ncomp(machine, truth, poses, first, rng))
            if len(plan.eyes) == 1:
                outcomes.setdefault("thesis, as published", []).append(_thesis(machine, truth, poses, first))
    for title, found in outcomes.items():
        _print(title, found)


def virtual_machine(machine: Machine, rng: np.random.Generator) -> ErrorModel:
    """A machine with the thesis' degrees and peaks; error motions start from zero at the first position."""
    effects: list[Effect] = [LocationError(*error) for error in LOCATIONS]
    for axis, positions in SERIES.items():
        low, high = float(positions.min()), float(positions.max())
        for component, peak, degree in zip(COMPONENTS, PEAKS[axis], DEGREES[axis], strict=True):
            basis = Polynomial((low, high), degree)
            x = np.linspace(low, high, 501)
            legendre = np.polynomial.legendre.Legendre(np.append(0.0, rng.uniform(-1, 1, degree)), [0.0, 1.0])
            powers = np.zeros(degree + 1)
            converted = legendre.convert(kind=np.polynomial.Polynomial).coef
            powers[: len(converted)] = converted
            powers[0] -= (basis.columns(positions[:1]) @ powers)[0]
            powers *= peak / np.abs(basis.columns(x) @ powers).max()
            effects.append(ErrorMotion(component, axis, basis, tuple(powers.tolist())))
    made = Provenance("benchmarks.thesis", datetime.datetime.now(datetime.UTC))
    return ErrorModel(machine=reference(machine), provenance=made, effects=tuple(effects))


def _poses(eyes: Mapping[str, tuple[float, float, float]], rng: np.random.Generator) -> dict[str, Pose]:
    """Poses of the stations, turned at random."""
    poses = {}
    for name, eye in eyes.items():
        rotation = rotation_vector_matrix(rng.uniform([[-0.5, -0.5, -3.0]], [[0.5, 0.5, 3.0]]))
        poses[name] = Pose(rotation, -(rotation[0] @ np.array(eye))[None])
    return poses


def _nominal(machine: Machine, stations: list[str]) -> tuple[Array, np.ndarray, np.ndarray, np.ndarray]:
    """Positions `(n, axes)`, mm and rad, targets, rounds and stations: axis, round, target in turn, position."""
    rows, targets, runs = [], [], []
    for run in range(ROUNDS):
        for name in (name for name, target in TARGETS.items() if target.carrier == "bed"):
            rows.append(np.zeros(len(machine.axes)))
            targets.append(name)
            runs.append(str(run + 1))
    for axis, values in SERIES.items():
        carrier = "tool" if machine.axes[machine.index(axis)].side == "tool" else "table"
        for run in range(ROUNDS):
            for name in (name for name, target in TARGETS.items() if target.carrier == carrier):
                for value in values:
                    rows.append([value if name_ == axis else 0.0 for name_ in machine.names])
                    targets.append(name)
                    runs.append(str(run + 1))
    station = np.array([stations[(int(run) - 1) % len(stations)] for run in runs])
    return np.array(rows) * machine.scale, np.array(targets), np.array(runs), station


def _measure(
    machine: Machine,
    truth: ErrorModel,
    poses: Mapping[str, Pose],
    rng: np.random.Generator,
    model: ErrorModel | None = None,
) -> Measurement:
    """Four rounds with noise; with a model, of the machine that it compensates."""
    nominal, targets, runs, station = _nominal(machine, list(poses))
    actual = nominal if model is None else _compensated(machine, model, nominal)
    state = State(actual, station=station, target=targets)
    blank = Measurement(machine, AT960, state, np.zeros((len(nominal), 3)), TARGETS, "bed", run=runs)
    registration = Registration(dict(poses), {name: np.zeros(3) for name in poses})
    seen = blank.instrument.expected(
        blank, registration, Observation(truth.errors(machine, state), np.zeros((len(nominal), 3)))
    )
    noise = np.linalg.cholesky(AT960.covariance(seen)) @ rng.standard_normal((len(seen), 3, 1))
    return replace(blank, state=replace(state, positions=nominal), observed=seen + noise[:, :, 0])


def _compensated(machine: Machine, model: ErrorModel, nominal: Array) -> Array:
    """Commands by the exact inverse, for the spindle nose."""

    def errors(q: Array) -> Array:
        return model.errors(machine, State(q))

    movable = np.ones(nominal.shape, bool)
    return correct_position(machine, errors, nominal, np.zeros((len(nominal), 3)), movable)


def _ncomp(
    machine: Machine, truth: ErrorModel, poses: Mapping[str, Pose], first: Measurement, rng: np.random.Generator
) -> Outcome:
    found = identify(first)
    linear = _with_effects(found.model, _linear(found.model, 1.0))
    for passed in range(1, PASSES):
        # the remaining error, found with the noise of one measurement and weighted by its share of them: their mean
        left_over = identify(_measure(machine, truth, poses, rng, linear), datums=found.datums).model
        linear = _with_effects(linear, [*linear.effects, *_linear(left_over, 1.0 / (1 + passed))])
    verified = identify(_measure(machine, truth, poses, rng, linear), datums=found.datums)
    names = list(found.datums)
    where = np.array([TARGETS[name].position for name in names])
    frame = rigid(where, np.array([found.datums[name] for name in names]))
    before, after, measured, u = {}, {}, {}, {}
    for axis in "XYZ":
        nominal = _line(machine, axis)
        errors = _errors(machine, truth, nominal, nominal, frame)
        left = _errors(machine, truth, _compensated(machine, linear, nominal), nominal, frame)
        again = _errors(machine, verified.model, nominal, nominal, IDENTITY)
        sigma = _uncertainty(machine, found.model, nominal)
        for j, component in enumerate("XYZ"):
            key = f"{component}{axis}"
            before[key], after[key] = _peak(errors[:, j]), _peak(left[:, j])
            u[key] = float(sigma[np.argmax(np.abs(errors[:, j])), j])
            measured[key] = _peak(again[:, j])
    return Outcome(before, u, after, measured, _volume(machine, truth, found.model, rng))


def _linear(model: ErrorModel, share: float) -> list[Effect]:
    """A share of the errors of the linear axes.

    As in the thesis; with B and C the lines would follow the table, which a tracker on the bed does not.
    """
    return [e.with_parameters([share * p for p in e.parameters], e.u) for e in model.effects if e.axes[0] in "XYZ"]


def _with_effects(model: ErrorModel, effects: list[Effect]) -> ErrorModel:
    """The model with some of its effects."""
    return msgspec.structs.replace(model, effects=tuple(effects), covariance=None)


def _thesis(machine: Machine, truth: ErrorModel, poses: Mapping[str, Pose], first: Measurement) -> Outcome:
    """The published procedure on the same readings, aligned to its X and Z lines; evaluated in its own frame."""
    assert first.state.target is not None
    assert first.run is not None
    rotation = _aligned(machine, first)
    origin = np.zeros(3)
    series, travels = {}, {}
    for axis in "XYZ":
        line = _line(machine, axis)
        points = np.empty((ROUNDS, len(line), 3, 3))
        for r in range(ROUNDS):
            for k, target in enumerate("PQK"):
                points[r, :, k] = first.observed[_rows(first, line, target, str(r + 1))] @ rotation.T
        series[axis], travels[axis] = points, SERIES[axis] - SERIES[axis][0]
    # the spindle's centre at the first position of X, from where the targets are known to sit
    known = np.array([TARGETS[name].position for name in "PQK"])
    for axis, points in series.items():
        origin = (points[:, 0] - known).mean(axis=(0, 1))
        series[axis] = points - origin
    model = thesis_procedure.identify(series, travels)
    ((_, pose),) = poses.items()
    frame = Pose((rotation @ pose.rotation[0])[None], np.zeros((1, 3)))
    before, after = {}, {}
    for axis in "XYZ":
        nominal = _line(machine, axis)
        columns = [machine.index(name) for name in "XYZ"]
        start = np.where([name == axis for name in "XYZ"], SERIES[axis][0], 0.0)
        commanded = nominal.copy()
        commanded[:, columns] = model.corrected(nominal[:, columns] - start) + start
        errors = _errors(machine, truth, nominal, nominal, frame)
        left = _errors(machine, truth, commanded, nominal, frame)
        for j, component in enumerate("XYZ"):
            before[f"{component}{axis}"], after[f"{component}{axis}"] = _peak(errors[:, j]), _peak(left[:, j])
    return Outcome(before, {}, after, {})


def _line(machine: Machine, axis: str) -> Array:
    rows = np.zeros((len(SERIES[axis]), len(machine.axes)))
    rows[:, machine.index(axis)] = SERIES[axis]
    return rows


def _rows(measurement: Measurement, line: Array, target: str, run: str) -> Array:
    """Rows of one round and target along a line, the first of each position."""
    assert measurement.state.target is not None
    assert measurement.run is not None
    mine = np.flatnonzero((measurement.state.target == target) & (measurement.run == run))
    away = np.abs(measurement.state.positions[mine][None, :, 2:] - line[:, None, 2:]).max(axis=2)
    return np.asarray(mine[np.argmin(away, axis=1)])


def _aligned(machine: Machine, first: Measurement) -> Array:
    """Rotation to the thesis' frame: x along the X line of P, z as near as may be to its Z line."""
    lines = []
    for axis in "XZ":
        points = np.mean(
            [first.observed[_rows(first, _line(machine, axis), "P", str(r + 1))] for r in range(ROUNDS)], axis=0
        )
        direction = np.linalg.svd(points - points.mean(axis=0))[2][0]
        lines.append(
            direction * np.sign(direction @ (points[-1] - points[0])) * np.sign(SERIES[axis][-1] - SERIES[axis][0])
        )
    x = lines[0]
    y = np.cross(lines[1], x)
    y /= np.linalg.norm(y)
    return np.array([x, y, np.cross(x, y)])


def _errors(machine: Machine, model: ErrorModel, commanded: Array, nominal: Array, frame: Pose) -> Array:
    """Errors `(n, 3)`, um, of the nose as seen from the bed, in a frame, from the first position."""
    errors = model.errors(machine, State(commanded))
    errors[:, [i for i, axis in enumerate(machine.axes) if axis.side != "tool"]] = 0.0
    actual = frame.apply(tool_point(machine, commanded, errors=errors))
    away = (actual - tool_point(machine, nominal)) * 1e3
    return np.asarray(away - away[0])


def _uncertainty(machine: Machine, model: ErrorModel, nominal: Array) -> Array:
    """Standard uncertainties `(n, 3)`, um, of the nose's measured errors from the first position."""
    on_tool = np.array([axis.side == "tool" for axis in machine.axes] + [True])
    transform = error_transform_with_tool(machine, nominal)[:, :3] * np.repeat(on_tool, 6)
    design = model.design(machine, State(nominal), transform) * 1e3
    design -= design[0]
    return np.asarray(np.sqrt(np.maximum(np.sum(design @ np.array(model.covariance) * design, axis=2), 0.0)))


def _volume(machine: Machine, truth: ErrorModel, model: ErrorModel, rng: np.random.Generator) -> tuple[float, float]:
    low = np.array([SERIES[name].min() for name in machine.names]) * machine.scale
    high = np.array([SERIES[name].max() for name in machine.names]) * machine.scale
    nominal = rng.uniform(low, high, (500, len(low)))
    nominal[:, machine.index("C")] *= 340.0 / np.rad2deg(high[machine.index("C")])
    points = forward(machine, nominal).translation
    rms = []
    for commanded in (nominal, _compensated(machine, model, nominal)):
        errors = truth.errors(machine, State(commanded))
        away = (exact_deviation(machine, commanded, errors).position + tool_point(machine, commanded) - points) * 1e3
        clamp = np.concatenate([np.broadcast_to(np.eye(3), (500, 3, 3)), by_turn(points)], axis=2).reshape(-1, 6)
        left = away.reshape(-1) - clamp @ np.linalg.lstsq(clamp, away.reshape(-1), rcond=None)[0]
        rms.append(float(np.sqrt(np.mean(np.sum(left.reshape(-1, 3) ** 2, axis=1)))))
    return rms[0], rms[1]


def _peak(values: Array) -> float:
    return float(np.abs(values).max())


def _print(title: str, outcomes: list[Outcome]) -> None:
    print(f"\n{title}: {len(outcomes)} draws; peaks in um, reductions in %, median (worst)")
    heads = (("", 6), ("before", 8), ("u", 7), ("above noise", 13), ("true after", 18), ("less", 16), ("80 %", 8))
    print("".join(f"{head:>{width}}" for head, width in (*heads, ("measured after", 18), ("less", 16))))
    for name in ERRORS:
        before = np.array([one.before[name] for one in outcomes])
        u = np.array([one.u.get(name, np.nan) for one in outcomes])
        cells = [f"E_{name:4}{np.median(before):8.1f}", f"{np.median(u):7.2f}" if np.isfinite(u[0]) else f"{'':7}"]
        cells.append(f"{np.sum(before > 2 * u):9}/{len(u)}" if np.isfinite(u[0]) else f"{'':13}")
        for after in ([one.after[name] for one in outcomes], [one.measured.get(name, np.nan) for one in outcomes]):
            if np.isfinite(after[0]):
                less = 100.0 * (1.0 - np.array(after) / before)
                cells.append(f"{np.median(after):10.2f} ({np.max(after):5.2f})")
                cells.append(f"{np.median(less):8.0f} ({np.min(less):5.0f})")
            if np.isfinite(after[0]) and len(cells) < 6:
                seen = before > 2 * u if np.isfinite(u[0]) else before > 0
                cells.append(f"{np.sum(less[seen] >= 80.0):5}/{np.sum(seen)}")
        print("".join(cells))
    volume = np.array([one.volume for one in outcomes])
    if volume.any():
        print(f"all five axes at random, rms: {np.median(volume[:, 0]):.1f} -> {np.median(volume[:, 1]):.2f} um")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
