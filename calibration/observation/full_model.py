"""The model at the start of a fit: the error motions of every axis that moves in the data."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from calibration.measurement.measurement import Measurement
from calibration.observation.mean_lines import centred, sizes_for_slope
from kinematics.basis import Basis, BSpline, Fourier, Harmonics, Interval, Legendre, Polynomial
from kinematics.effects import Backlash, Effect, ErrorMotion
from kinematics.effects.base import UM
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.turn import gap_of
from kinematics.user_error import UserError

ROTARY = "ABC"
"""First letters of the names of rotary axes."""
SQUARENESS = ("XY", "XZ", "YZ")
"""Direction and axis of the straightness error motions whose slopes are squareness; X is x, Y lies in the x y plane."""
TARGETS = "targets"
"""Kind of basis with a node at each target of an interferometer's runs."""
SLOPED = 1e-2
"""Size of a parameter, as a share of the largest, from which it counts as a part of the slope."""
PERIOD_IN_TRAVELS = 1.25
"""Period of the waves of a linear axis, in travels: errors at both ends of the travel need not be equal."""
LOGGED_POSITIONS = 240
"""Least number of positions in the log of a moving axis."""
MEAN_REPEATS = 3
"""Least mean number of readings of a target in repeated runs."""
_KINDS = (
    "b-spline:N, cubic:N (nodes), legendre:N, polynomial:N (degree), fourier:N (harmonics), "
    f"waves:N (over {PERIOD_IN_TRAVELS} travels), targets:N (nodes)"
)


@dataclass(frozen=True)
class BasisChoice:
    """Basis of the error motions of an axis, without its interval."""

    kind: str
    """b-spline (degree 1, an interpolated table), cubic, legendre, polynomial, fourier, waves or targets."""
    size: int
    """Nodes, degree, harmonics, or number of targets."""

    def __str__(self) -> str:
        return f"{self.kind}:{self.size}"

    def over(self, interval: Interval, *, closed: bool = False, rotary: bool = False) -> Basis:
        """The basis over an interval, mm or degrees; closed: the interval is a whole turn, where the errors repeat.

        rotary: of a rotary axis, which shifts and tilts what it carries in a harmonic of its turn.
        """
        turns = (interval[1] - interval[0]) / 180.0
        match self.kind:
            case "b-spline" | "cubic" | "targets":
                nodes = np.linspace(*interval, self.size).tolist()
                return BSpline(tuple(nodes), 3 if self.kind == "cubic" else 1)
            case "legendre":
                return Legendre(interval, self.size)
            case "polynomial":
                return Polynomial(interval, self.size)
            case "waves":
                waves = (2.0 / PERIOD_IN_TRAVELS * n for n in range(1, self.size + 1))
                return Fourier(interval, (turns, *waves) if rotary else tuple(waves))
            case _ if closed:
                return Harmonics(interval, self.size)
            case _:
                return Fourier(interval, tuple(turns * n for n in range(1, self.size + 1)))


def parse_basis(text: str) -> BasisChoice:
    """A choice such as `b-spline:12` or `legendre:5`; UserError, with the known kinds, for any other text."""
    found = re.fullmatch(r"(b-spline|cubic|legendre|polynomial|fourier|waves|targets):(\d+)", text.strip())
    if not found:
        raise UserError(f"basis {text!r} is none of {_KINDS}")
    choice = BasisChoice(found[1], int(found[2]))
    least = 2 if choice.kind in ("b-spline", "cubic", TARGETS) else 0
    most = 1000 if least else 50
    if not least <= choice.size <= most:
        raise UserError(f"basis {text!r}: the number is out of range: expected {least} to {most}")
    return choice


def stated_bases(text: str, axes: Sequence[str]) -> dict[str, BasisChoice]:
    """The bases of the axes that move in the data, from `legendre:5` or `X=b-spline:12,Y=legendre:5`."""
    if "=" not in text:
        return dict.fromkeys(axes, parse_basis(text))
    bases: dict[str, BasisChoice] = {}
    for entry in text.split(","):
        axis, _, choice = entry.partition("=")
        bases[axis.strip()] = parse_basis(choice)
    missing = [axis for axis in axes if axis not in bases]
    if missing:
        raise UserError(f"basis {text!r} has no entry for {', '.join(missing)}, which moves in these data")
    unknown = [axis for axis in bases if axis not in axes]
    if unknown:
        raise UserError(f"basis {text!r}: {', '.join(unknown)} does not move in these data")
    return {axis: bases[axis] for axis in axes}


def rigid_model(measurement: Measurement, bases: Mapping[str, BasisChoice]) -> ErrorModel:
    """The model of `axis_effects` of each axis that moves in the data; `bases` by axis. UserError where none moves."""
    effects = [effect for axis in measurement.moving for effect in axis_effects(measurement, axis, bases[axis])]
    if not effects:
        raise UserError(f"{measurement.source}: no axis moves in these data: measure at several positions")
    return msgspec.structs.replace(measurement.nominal_model, effects=tuple(effects))


def axis_effects(measurement: Measurement, axis: str, choice: BasisChoice) -> list[Effect]:
    """The fitted effects of one axis that moves: its error motions, and the backlash for an interferometer."""
    motions = axis_motions(measurement, axis, choice)
    return [*motions, Backlash(axis, 0.0)] if measurement.errors_shown[axis].backlash else [*motions]


def axis_motions(measurement: Measurement, axis: str, choice: BasisChoice) -> list[Effect]:
    """The error motions of an axis that the instrument may show, all zero; six about the measured points' centre.

    For an interferometer: those that it observes, by default the positioning error.
    """
    arc, own = measurement.moving[axis], measurement.machine.axes[measurement.machine.index(axis)]
    basis = choice.over(arc, closed=own.turns_fully and not gap_of(arc), rotary=own.rotary)
    if choice.kind == TARGETS:
        basis = _at_targets(measurement, axis, choice)
    zero = (0.0,) * basis.size
    shown = measurement.errors_shown[axis].motions
    motions = [ErrorMotion(component, axis, basis, zero, u=zero) for component in shown]
    return list(centred(motions, {} if measurement.axis_rows else measurement.arms))


def _at_targets(measurement: Measurement, axis: str, choice: BasisChoice) -> Basis:
    """The table with a node at each target; UserError where the runs do not have so many targets."""
    nodes = repeated_targets(measurement, axis)
    if len(nodes) != choice.size:
        found = f"{len(nodes)} targets" if nodes else "no repeated targets"
        raise UserError(f"basis {choice} of {axis}: the runs of an interferometer have {found} of this axis")
    return BSpline(tuple(nodes), 1)


def with_effects(
    measurement: Measurement,
    bases: Mapping[str, BasisChoice],
    effects: Sequence[Effect],
    prior_scale: float,
    rotary_scale: float | None = None,
) -> tuple[ErrorModel, np.ndarray]:
    """The rigid model with additional effects, and priors `(parameters,)`; `prior_scale`: factor of the rigid ones.

    rotary_scale: the factor of rotary axes, where it is another one.
    """
    rigid = rigid_model(measurement, bases)
    model = msgspec.structs.replace(rigid, effects=(*rigid.effects, *effects))
    prior = priors(model)
    scales = np.full(len(prior), prior_scale)
    for motion, part in rigid.error_motions:
        if rotary_scale is not None and motion.axis[0] in ROTARY:
            scales[part] = rotary_scale
    own = slice(0, len(rigid.parameters))
    prior[own] = np.maximum(prior[own] * scales[own], least_priors(measurement, rigid))
    return model, prior


def least_priors(measurement: Measurement, model: ErrorModel) -> np.ndarray:
    """Smallest prior standard deviations `(parameters,)`, whatever the scale, as the instrument needs them.

    Location errors are constants of rotary axes' error motions and slopes of straightness of linear axes. In a table
    each node has a part in the slope: wide nodes would be jumps, so that only two of them are a slope.
    """
    errors = measurement.instrument.least_errors
    least = np.where(errors.typical_lines & _constants(measurement.machine, model), priors(model), 0.0)
    for effect, part in zip(model.effects, model.slices, strict=True):
        if effect.kind == "backlash":
            least[part] = errors.backlash_um
    for motion, part in model.error_motions:
        if errors.squareness_urad and motion.component + motion.axis[0] in SQUARENESS:
            # 1 urad is 1e-3 um per mm
            least[part] = sizes_for_slope(motion.basis, errors.squareness_urad * UM)
        if errors.slope_um_per_mm and not motion.angular:
            sizes = sizes_for_slope(motion.basis, errors.slope_um_per_mm)
            sizes[sizes < SLOPED * sizes.max(initial=0.0)] = 0.0
            least[part] = sizes if np.count_nonzero(sizes) <= 2 else least[part]
    return least


def _constants(machine: Machine, model: ErrorModel) -> np.ndarray:
    """Mask `(parameters,)` of the constants of rotary axes' error motions, in bases that have one."""
    mask = np.zeros(len(model.parameters), bool)
    for motion, part in model.error_motions:
        waves = isinstance(motion.basis, Fourier | Harmonics)
        mask[part.start] = waves and machine.axes[machine.index(motion.axis)].rotary
    return mask


def repeated_targets(measurement: Measurement, axis: str) -> list[float]:
    """Target positions of an axis, mm or degrees, that the runs of an interferometer visit again and again; else empty.

    They are as many as `MEAN_REPEATS` allows, as in a test by ISO 230-2. Empty also for an axis that turns fully: its
    errors repeat with the turn.
    """
    rows = measurement.axis_rows.get(axis)
    if rows is None or measurement.machine.axes[measurement.machine.index(axis)].turns_fully:
        return []
    position = np.round(measurement.state.position(measurement.machine, axis)[rows], 3)
    targets, visits = np.unique(position, return_counts=True)
    return targets.tolist() if 2 < len(targets) * MEAN_REPEATS <= len(position) and visits.min() > 1 else []


def is_log(measurement: Measurement, axis: str) -> bool:
    """True for an axis that was observed by itself at `LOGGED_POSITIONS` or more.

    Its positions show waves of any length, so that no basis has to.
    """
    return axis in measurement.axis_rows and measurement.distinct_positions[axis] >= LOGGED_POSITIONS


def priors(model: ErrorModel) -> np.ndarray:
    """Prior standard deviations `(parameters,)` in the units of the parameters: their typical sizes."""
    return np.array([size for effect in model.effects for size in effect.typical])
