"""Comparison of two calibrations of one machine, error motion by error motion, in the conventions of ISO 230-1.

Every error motion is calculated from all effects that depend on positions alone, as a function of its own
axis with the others at home, without a direction of approach, over the common range of both calibrations:

| | convention |
|---|---|
| positioning and angular error motions of a linear axis | zero at the reference position |
| straightness | deviation from the end-point or least-squares line, whose slope is part of squareness |
| angular positioning of a rotary axis | zero at the reference position |
| radial, axial and tilt error motions of a rotary axis | minus their mean, listed separately as location error |

Both calibrations are first transformed into one frame (`common_frame`). The difference is B minus A. All values are
linear in the errors, so that uncertainties follow from the parameters' covariance to first order (GUM). The two
calibrations are assumed to be independent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import ndtri

from calibration.evaluation.common_frame import Sampled, common_frame
from calibration.evaluation.volumetric import VolumetricError, volumetric_error_um
from calibration.single_axis.reference_lines import reference_line
from kinematics.basis import Interval
from kinematics.deviation import exact_deviation
from kinematics.effects import COMPONENTS, Effect
from kinematics.effects.base import own_component, own_motion, unit_of
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool, pose_slopes
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

Straightness = Literal["end-point", "least-squares"]
POSITIONS = 121
"""Number of positions along an axis."""
TURN = 360.0
"""Largest compared range of a rotary axis, degrees: one turn."""
POINTS = 1000
"""Number of positions in the common volume, random with a fixed seed."""
COVERAGE = 2.0
"""Coverage factor k of the expanded uncertainty U."""
CONFIDENCE = 0.95
"""Probability with which two calibrations that agree show no significant difference of an error motion."""
LEAST = 1e-9
"""Smallest error, um or urad; smaller ones count as zero."""


class Figure(NamedTuple):
    """One number of both calibrations; um, or urad (um/m)."""

    name: str
    title: str
    unit: str
    a: float
    b: float
    U_a: float
    U_b: float

    @property
    def U(self) -> float:
        """Expanded uncertainty of the difference, k = 2."""
        return float(np.hypot(self.U_a, self.U_b))

    def json(self) -> dict[str, Any]:
        """The figure as JSON."""
        numbers = {"a": self.a, "b": self.b, "difference": self.b - self.a, "U_difference": self.U}
        return {"name": self.name, "title": self.title, "unit": self.unit, **numbers}


@dataclass(frozen=True)
class Motion:
    """One error motion in both calibrations, in its convention; um or urad."""

    name: str
    axis: str
    position_unit: str
    unit: str
    convention: str
    positions: Array
    """Positions `(n,)`, mm or degrees."""
    a: Array
    b: Array
    U_a: Array
    U_b: Array
    known: tuple[bool, bool]
    """True for each calibration, A and B, that contains the error motion."""
    significant: bool
    """True if the uncertainties explain the difference, over all positions, with less than 5 % probability."""

    @property
    def difference(self) -> Array:
        """Difference B minus A `(n,)`, um or urad."""
        return self.b - self.a

    @property
    def U(self) -> Array:
        """Expanded uncertainties of the differences, k = 2, `(n,)`."""
        return np.hypot(self.U_a, self.U_b)

    @property
    def largest(self) -> int:
        """Row of the largest difference."""
        return int(np.argmax(np.abs(self.difference)))

    def json(self) -> dict[str, Any]:
        """The error motion as JSON."""
        i = self.largest
        at = f"position_{self.position_unit}"
        return {
            "name": self.name,
            "axis": self.axis,
            "unit": self.unit,
            "convention": self.convention,
            "in": [name for name, known in zip("ab", self.known, strict=True) if known],
            "range": {"a": float(np.ptp(self.a)), "b": float(np.ptp(self.b))},
            "rms_difference": float(np.sqrt(np.mean(self.difference**2))),
            "largest": {"difference": float(self.difference[i]), at: float(self.positions[i]), "U": float(self.U[i])},
            "significant": self.significant,
            "curves": {
                f"positions_{self.position_unit}": self.positions.tolist(),
                "a": self.a.tolist(),
                "b": self.b.tolist(),
                "U_a": self.U_a.tolist(),
                "U_b": self.U_b.tolist(),
            },
        }


class Volume(NamedTuple):
    """The difference B minus A of the tool point over the common volume."""

    bounds: Mapping[str, Interval]
    """Bounds of the common volume by axis, mm or degrees."""
    tool_mm: float
    difference: VolumetricError
    aligned: VolumetricError
    """The difference after a rigid alignment of one calibration to the other."""
    u_rms_um: float
    """RMS of the standard uncertainty of the difference, um: the expected difference of two calibrations that agree."""

    def json(self) -> dict[str, Any]:
        """The volume as JSON."""
        return {
            "bounds": {axis: list(ends) for axis, ends in self.bounds.items()},
            "tool_mm": self.tool_mm,
            "difference_um": {"rms": self.difference.rms, "p95": self.difference.p95, "max": self.difference.largest},
            "aligned_um": {"rms": self.aligned.rms, "p95": self.aligned.p95, "max": self.aligned.largest},
            "u_rms_um": self.u_rms_um,
        }


@dataclass(frozen=True)
class Comparison:
    """Result of the comparison."""

    machine: Machine
    reference: Mapping[str, float]
    """Reference positions by axis, mm or degrees."""
    straightness: Straightness
    motions: tuple[Motion, ...]
    figures: tuple[Figure, ...]
    """Squareness, location errors of rotary axes, reversal."""
    volume: Volume
    left_out: tuple[str, ...]
    """Effects that were not compared, each with the reason."""

    def json(self) -> dict[str, Any]:
        """The comparison as JSON: U with k = 2; differences are B minus A."""
        return {
            "machine": self.machine.name,
            "difference": "b minus a",
            "straightness": self.straightness,
            "reference": dict(self.reference),
            "error_motions": [motion.json() for motion in self.motions],
            "figures": [figure.json() for figure in self.figures],
            "volume": self.volume.json(),
            "not_compared": list(self.left_out),
        }


class _Curve(NamedTuple):
    """Error motion of one calibration: values `(n,)`, and derivatives with respect to its parameters `(n, p)`."""

    values: Array
    design: Array


class _Side:
    """One of the two calibrations: its effects that depend on position and approach alone."""

    def __init__(self, machine: Machine, model: ErrorModel) -> None:
        self.machine = machine
        self.model = model.part(lambda effect: not _left_out(effect))
        self.intervals = _intervals(machine, self.model)

    def curve(self, i: int, k: int, positions: Array, sign: float = 0.0) -> _Curve:
        """Component k of axis i, um or urad, at positions in mm and rad; `sign`: direction of approach, -1, 0 or 1."""
        state = _along(self.machine, i, positions, sign)
        values = self.model.errors(self.machine, state)[:, i, k]
        chosen = np.zeros((len(positions), 1, 6 * (len(self.machine.axes) + 1)))
        chosen[:, :, 6 * i + k] = 1.0
        design = self.model.design(self.machine, state, chosen)[:, 0]
        size = unit_of(COMPONENTS[k])[1]
        return _Curve(values / size, design / size)

    def covariance(self, design: Array) -> Array:
        """Covariance `(n, n)` of quantities with these derivatives `(n, p)`."""
        if self.model.covariance is not None:
            return np.asarray(design @ np.array(self.model.covariance) @ design.T)
        u = np.array([v for effect in self.model.effects for v in effect.uncertainties])
        return np.asarray((design * u**2) @ design.T)

    def U(self, design: Array) -> float:
        """Expanded uncertainty of one quantity with these derivatives `(p,)`."""
        return float(COVERAGE * np.sqrt(np.maximum(self.covariance(design[None])[0, 0], 0.0)))


def compare(
    machine: Machine,
    models: tuple[ErrorModel, ErrorModel],
    straightness: Straightness = "end-point",
    references: Mapping[str, float] | None = None,
    tool_mm: float = 100.0,
) -> Comparison:
    """Comparison of two calibrations of the machine; `references`: positions by axis, mm or degrees, default home."""
    sides = (_Side(machine, models[0]), _Side(machine, models[1]))
    left_out = [
        f"{effect.name} of {letter}: {_left_out(effect)}"
        for letter, model in zip("AB", models, strict=True)
        for effect in model.effects
        if _left_out(effect)
    ]
    tracks, outside = _tracks(machine, sides, references or {})
    left_out += outside
    motions, figures = [], []
    for track, pair in zip(tracks, _in_common_frame(machine, sides, tracks), strict=True):
        rule = _rule(machine, track, straightness)
        motions.append(_motion(machine, sides, track, pair, rule))
        if rule.mean:
            figures.append(_location(sides, track.name(machine), pair, unit_of(COMPONENTS[track.component])[0]))
    figures = [*_squareness(machine, sides, straightness), *figures, *_reversals(machine, sides)]
    return Comparison(
        machine,
        {machine.names[track.axis]: track.reference for track in tracks},
        straightness,
        tuple(motions),
        tuple(figures),
        _volume(machine, sides, tool_mm),
        tuple(left_out),
    )


def _tracks(
    machine: Machine, sides: Sequence[_Side], references: Mapping[str, float]
) -> tuple[list[Sampled], list[str]]:
    """The error motions of either calibration over their common ranges, and notes on those without a common range."""
    tracks, outside = [], []
    used: dict[str, float] = {}
    for i, axis in enumerate(machine.axes):
        for k in range(6):
            ends = _common(sides, i, k)
            name = f"E_{COMPONENTS[k]}{axis.name}"
            if ends is None:
                continue
            if ends[0] >= ends[1]:
                outside.append(f"{name}: the two calibrations have no common range")
                continue
            at = used.setdefault(axis.name, _reference(machine, i, ends, references))
            tracks.append(Sampled(i, k, ends, _positions(machine, i, ends), at))
    return tracks, outside


def _in_common_frame(
    machine: Machine, sides: Sequence[_Side], tracks: Sequence[Sampled]
) -> Iterator[tuple[_Curve, ...]]:
    """Each error motion of both calibrations, at its positions and, last, at the reference."""
    if not tracks:
        return
    frame = common_frame(machine, tracks)
    ends = np.cumsum([len(track.everywhere) for track in tracks])[:-1]
    pairs = []
    for side in sides:
        curve = [
            side.curve(track.axis, track.component, track.everywhere * machine.scale[track.axis]) for track in tracks
        ]
        values = np.split(frame.moved(np.concatenate([each.values for each in curve])), ends)
        designs = np.split(frame.moved(np.concatenate([each.design for each in curve])), ends)
        pairs.append(map(_Curve, values, designs))
    yield from zip(*pairs, strict=True)


def _left_out(effect: Effect) -> str:
    """Reason why an effect is not compared; empty if it is."""
    if effect.ACTS_ON == "instrument":
        return "an effect of the instrument"
    others = [need.replace("_", " ") for need in effect.needs if need != "approach"]
    others += [f"temperature {sensor}" for sensor in effect.sensors]
    return f"depends on {', '.join(dict.fromkeys(others))}" if others else ""


def _along(machine: Machine, i: int, positions: Array, sign: float) -> State:
    q = np.tile([axis.home for axis in machine.axes] * machine.scale, (len(positions), 1))
    q[:, i] = positions
    approach = np.zeros(q.shape)
    approach[:, i] = sign
    return State(q, approach=approach)


def _intervals(machine: Machine, model: ErrorModel) -> dict[tuple[int, int], Interval]:
    """Intervals, mm or degrees, in which the effects of the model are defined, by axis and component."""
    found: dict[tuple[int, int], Interval] = {}
    for effect in model.effects:
        known = effect.intervals
        for key, component, _ in effect.columns(machine, _along(machine, 0, np.zeros(1), 1.0)):
            if not 0 <= key < len(machine.axes):
                continue
            axis = machine.axes[key]
            low, high = known.get(axis.name, axis.travel)
            before = found.get((key, component), axis.travel)
            found[key, component] = max(before[0], low), min(before[1], high)
    return found


def _common(sides: Sequence[_Side], i: int, k: int) -> Interval | None:
    """The common range of an error motion, mm or degrees, at most a turn; None if neither calibration has it."""
    known = [side.intervals[i, k] for side in sides if (i, k) in side.intervals]
    if not known:
        return None
    low, high = max(ends[0] for ends in known), min(ends[1] for ends in known)
    axis = sides[0].machine.axes[i]
    if axis.rotary and high - low > TURN:
        low = min(max(low, axis.home - TURN / 2.0), high - TURN)
        high = low + TURN
    return low, high


def _positions(machine: Machine, i: int, ends: Interval) -> Array:
    """Positions `(n,)` over a range, mm or degrees; for a whole turn without the repeated end."""
    whole = machine.axes[i].rotary and ends[1] - ends[0] >= TURN
    return np.linspace(*ends, POSITIONS, endpoint=not whole)


def _reference(machine: Machine, i: int, ends: Interval, references: Mapping[str, float]) -> float:
    axis = machine.axes[i]
    at = references.get(axis.name)
    if at is None:
        return float(np.clip(axis.home, *ends))
    if not ends[0] <= at <= ends[1]:
        raise UserError(
            f"--reference {axis.name}={at:g}: the common range of both calibrations is {axis.name} from {ends[0]:g} to "
            f"{ends[1]:g} {axis.unit}"
        )
    return at


class _Rule(NamedTuple):
    """Linear map of the values of an error motion to its convention."""

    text: str
    matrix: Array
    """Factors `(n, n + 1)` of its values at the positions and, last, at the reference."""
    mean: bool = False
    """True if the mean of the error motion is a location error."""


def _rule(machine: Machine, track: Sampled, straightness: Straightness) -> _Rule:
    axis, k, x, n = machine.axes[track.axis], track.component, track.positions, len(track.positions)
    own = COMPONENTS[k] == own_component(axis.name)
    if axis.rotary and not own:
        return _Rule("less its mean", np.eye(n, n + 1) - np.append(np.full(n, 1.0 / n), 0.0), mean=True)
    if axis.rotary or own or k >= 3:
        return _Rule("zero at the reference", np.eye(n, n + 1) - np.eye(1, n + 1, n))
    line = reference_line(straightness, x, np.zeros(n))
    matrix = np.concatenate([line.residual_of(x), np.zeros((n, 1))], axis=1)
    return _Rule(f"from the {straightness} line", matrix)


def _motion(machine: Machine, sides: Sequence[_Side], track: Sampled, pair: Sequence[_Curve], rule: _Rule) -> Motion:
    axis, key = machine.axes[track.axis], (track.axis, track.component)
    values = [rule.matrix @ curve.values for curve in pair]
    covariances = [side.covariance(rule.matrix @ curve.design) for side, curve in zip(sides, pair, strict=True)]
    U = [COVERAGE * np.sqrt(np.maximum(np.diag(covariance), 0.0)) for covariance in covariances]
    significant = _significant(values[1] - values[0], covariances[0] + covariances[1])
    known = (key in sides[0].intervals, key in sides[1].intervals)
    unit = unit_of(COMPONENTS[track.component])[0]
    return Motion(
        track.name(machine),
        axis.name,
        axis.unit,
        unit,
        rule.text,
        track.positions,
        values[0],
        values[1],
        U[0],
        U[1],
        known,
        significant,
    )


def _significant(difference: Array, covariance: Array) -> bool:
    """True if a difference `(n,)` exceeds its uncertainty at any position, tested over all positions together.

    The coverage factor is that of Sidak for the number of independent positions that follows from the correlations
    (participation ratio): one position gives k = 1.96, a polynomial of five terms about 2.5.
    """
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size, known = np.maximum(np.abs(difference) - LEAST, 0.0), u > LEAST
    if np.any(size[~known] > 0.0) or not known.any():
        return bool(np.any(size > 0.0))
    correlation = covariance[np.ix_(known, known)] / np.outer(u[known], u[known])
    independent = known.sum() ** 2 / np.sum(correlation**2)
    k = ndtri((1.0 + CONFIDENCE ** (1.0 / independent)) / 2.0)
    return bool(np.any(size[known] > k * u[known]))


def _location(sides: Sequence[_Side], name: str, pair: Sequence[_Curve], unit: str) -> Figure:
    """The mean of an error motion of a rotary axis."""
    means = [float(curve.values[:-1].mean()) for curve in pair]
    U = [side.U(curve.design[:-1].mean(axis=0)) for side, curve in zip(sides, pair, strict=True)]
    return Figure(f"{name[:3]}0{name[3:]}", "location of the axis line", unit, *means, *U)


SQUARENESS = {("Y", "X"): ("C", -1.0), ("Z", "X"): ("B", 1.0), ("Z", "Y"): ("A", -1.0)}
"""Squareness of the second axis to the first: the letter of E_C0Y - E_C0X, and its sign in their scalar product."""


def _squareness(machine: Machine, sides: Sequence[_Side], straightness: Straightness) -> Iterator[Figure]:
    """E_C0Y - E_C0X, E_B0Z - E_B0X and E_A0Z - E_A0Y, of the first linear axis of each letter, um/m.

    The change of the angle between the lines along which two axes move the tool in the workpiece frame. A rotation
    common to all axes does not change it; neither does a constant angle of an axis that the straightness of the axes on
    it compensates.
    """
    first: dict[str, int] = {}
    for i, axis in enumerate(machine.axes):
        if not axis.rotary:
            first.setdefault(own_component(axis.name), i)
    for (second, other), (letter, sign) in SQUARENESS.items():
        if second not in first or other not in first:
            continue
        i, j = first[second], first[other]
        ends = [_common(sides, i, COMPONENTS.index(other)), _common(sides, j, COMPONENTS.index(second))]
        lines = [_direction(machine, i), _direction(machine, j)]
        scale = sign * 1e6 / float(np.linalg.norm(np.cross(lines[0], lines[1])))
        found = []
        for side in sides:
            leans = [_lean(side, a, known, straightness) for a, known in zip((i, j), ends, strict=True)]
            value = scale * (lines[1] @ leans[0].values + lines[0] @ leans[1].values)
            design = scale * (lines[1] @ leans[0].design + lines[0] @ leans[1].design)
            found.append((float(value), side.U(design), design.any()))
        if any(curve for *_, curve in found):
            names = machine.names[i], machine.names[j]
            name = f"E_{letter}0{names[0]} - E_{letter}0{names[1]}"
            title = f"squareness of {names[0]} to {names[1]}"
            yield Figure(name, title, "um/m", found[0][0], found[1][0], found[0][1], found[1][1])


def _direction(machine: Machine, i: int) -> Array:
    """Direction `(3,)` of the tool in the workpiece frame if a linear axis moves along its letter, others at home."""
    home = _along(machine, i, np.array([machine.axes[i].home]), 0.0)
    slope = pose_slopes(machine, home.positions)[0, :3, i]
    return np.asarray(own_motion(machine, machine.names[i])[2] * slope / np.linalg.norm(slope))


def _lean(side: _Side, i: int, ends: Interval | None, straightness: Straightness) -> _Curve:
    """Tilt of the line of a linear axis against its direction: vector `(3,)`, workpiece frame, mm per mm.

    The slope of the reference line through the deviations across the axis over a range, mm. The axis' own angular
    error motions count with their values at home, because their variation bends the line by an amount that depends on
    the tool point.
    """
    machine = side.machine
    axis, direction = machine.axes[i], _direction(machine, i)
    low, high = ends if ends is not None and ends[0] < ends[1] else (axis.home, axis.home + 1.0)
    x = np.linspace(low, high, POSITIONS)
    here, home = _along(machine, i, x, 0.0), _along(machine, i, np.full(POSITIONS, axis.home), 0.0)
    across = np.eye(3) - np.outer(direction, direction)
    slope = own_motion(machine, axis.name)[2] * reference_line(straightness, x, np.zeros(POSITIONS)).slope_of
    transform = across @ error_transform_with_tool(machine, here.positions)[:, :3]
    own = np.zeros(transform.shape[2])
    own[6 * i + 3 : 6 * i + 6] = 1.0
    parts = ((here, transform * (1.0 - own)), (home, transform * own))
    errors = [side.model.errors(machine, state).reshape(POSITIONS, 1, -1) for state, _ in parts]
    values = [np.sum(part * each, axis=2) for (_, part), each in zip(parts, errors, strict=True)]
    designs = [side.model.design(machine, state, part) for state, part in parts]
    return _Curve(slope @ (values[0] + values[1]), np.tensordot(slope, designs[0] + designs[1], axes=1))


def _reversals(machine: Machine, sides: Sequence[_Side]) -> Iterator[Figure]:
    """Mean reversal of each axis, forward minus backward, if either calibration has one."""
    for i, axis in enumerate(machine.axes):
        _, k, forward = own_motion(machine, axis.name)
        ends = _common(sides, i, k)
        if ends is None or ends[0] >= ends[1]:
            continue
        x = _positions(machine, i, ends) * machine.scale[i]
        found = []
        for side in sides:
            ahead, behind = side.curve(i, k, x, 1.0), side.curve(i, k, x, -1.0)
            value = forward * float(np.mean(ahead.values - behind.values))
            found.append((value, side.U((ahead.design - behind.design).mean(axis=0))))
        if any(abs(value) > LEAST for value, _ in found):
            unit = unit_of(COMPONENTS[k])[0]
            title = "mean reversal, forward minus backward"
            yield Figure(f"B {axis.name}", title, unit, found[0][0], found[1][0], found[0][1], found[1][1])


def _volume(machine: Machine, sides: Sequence[_Side], tool_mm: float) -> Volume:
    """The difference of the tool point at random positions of the common volume; other axes at home."""
    bounds: dict[str, Interval] = {}
    low, high = (np.array([axis.home for axis in machine.axes]) for _ in range(2))
    for i, axis in enumerate(machine.axes):
        known = [ends for k in range(6) if (ends := _common(sides, i, k)) is not None]
        ends = (max((e[0] for e in known), default=axis.home), min((e[1] for e in known), default=axis.home))
        if ends[0] < ends[1]:
            low[i], high[i] = ends
            bounds[axis.name] = ends
    q = np.random.default_rng(0).uniform(low, high, (POINTS, len(machine.axes))) * machine.scale
    tool = (0.0, 0.0, -tool_mm)
    state = State(q, approach=np.zeros(q.shape))
    deviations = [exact_deviation(machine, q, side.model.errors(machine, state), tool).position for side in sides]
    difference = deviations[1] - deviations[0]
    transform = error_transform_with_tool(machine, q, tool)[:, :3]
    u = [side.model.standard_uncertainty(machine, state, transform) * 1e3 for side in sides]
    expected = float(np.sqrt(np.mean(np.sum(u[0] ** 2 + u[1] ** 2, axis=1))))
    return Volume(
        bounds,
        tool_mm,
        volumetric_error_um(difference),
        volumetric_error_um(difference, tool_point(machine, q, tool)),
        expected,
    )
