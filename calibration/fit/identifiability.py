"""Identifiability: null directions of the fit by the effects they lie in, each with its reason and its remedy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.fit.datum import gauge, null_space
from calibration.fit.fit import Fit
from calibration.fit.linear import singular_values
from calibration.instruments.base import INDEPENDENT, along_itself, axes_of
from calibration.observation.full_model import ROTARY
from kinematics.basis import Fourier, Harmonics, Legendre
from kinematics.effects import Effect, ErrorMotion
from kinematics.transforms import Array

WITHIN_EFFECTS_SHARE = 1e-6
"""Squared share of a direction outside some effects, below which it lies within them."""
ROUNDING_OF_SHARE = 1e-2
"""Share of a direction below which it is rounding."""

ON_TABLE = (
    "targets on the table (# table.NAME: x y z) would show it: from the bed, targets on the tool do not move with it"
)
UNLIKE_LINES = (
    "lines that are not alike about the middle would show it (ncomp plan path); another tool vector would not"
)
"""Measurements that would determine effects."""


class Low(NamedTuple):
    """Degree, and number of harmonics, of error motions of which it is asked whether rows show them."""

    degree: int
    harmonics: int


LOW_CUBICS, LOW_LINES = Low(3, 2), Low(1, 1)
"""What a report says of error motions; and what rows must show at least: lines, and shifts and tilts of a turn."""


@dataclass(frozen=True)
class Unidentifiable:
    """Directions of the parameters that the data do not determine."""

    effects: tuple[str, ...]
    """Names of the effects they lie in."""
    directions: int
    """Number of such directions."""
    parameters: int
    """Number of parameters of these effects."""
    reason: str
    remedy: str

    def __str__(self) -> str:
        names = " and ".join(self.effects) if len(self.effects) < 4 else ", ".join(self.effects)
        return f"{names}: {self.reason}; {self.remedy}"


@dataclass(frozen=True)
class Identifiability:
    """Rank and unidentifiable directions of a fit."""

    parameters: int
    rank: int
    """Number of parameters that the data determine if the position of the instrument is known."""
    rank_registered: int
    """Number of parameters that the data determine with the position of the instrument unknown, as in the fit."""
    by_convention: int
    """Number of directions that no measurement can show: the datum fixes them."""
    unidentifiable: tuple[Unidentifiable, ...]
    """Directions that this measurement does not determine, but another could."""

    @property
    def not_visible(self) -> list[str]:
        """Effects that these data do not show at all."""
        return [b.effects[0] for b in self.unidentifiable if len(b.effects) == 1 and b.directions == b.parameters]


def of_low_degrees(fit: Fit, positions: Mapping[str, int], low: Low = LOW_CUBICS) -> Fit:
    """The fit as one of the error motions' low degrees alone, no more of them than positions of each axis show.

    Its information is that for the others known: their priors limit them, wherever the rows do not show them.
    """
    motions = {part.start: motion for motion, part in fit.model.error_motions}
    effects: list[Effect] = []
    columns = []
    for effect, part in zip(fit.model.effects, fit.model.slices, strict=True):
        motion = motions.get(part.start)
        coarse = effect if motion is None else _of_low_degree(motion, positions[motion.axis], low)
        effects.append(coarse)
        columns.append(np.arange(part.start, part.start + len(coarse.parameters)))
    kept = np.concatenate([np.zeros(0, int), *columns])
    own = np.ix_(kept, kept)
    solved = fit.solved._replace(
        information=fit.solved.information[own], machine_information=fit.solved.machine_information[own]
    )
    model = msgspec.structs.replace(fit.model, effects=tuple(effects), covariance=None)
    return replace(fit, model=model, prior=fit.prior[kept], away=fit.away[kept], solved=solved)


def _of_low_degree(motion: ErrorMotion, positions: int, low: Low) -> ErrorMotion:
    """An error motion of a low degree, or few harmonics, at most."""
    basis, most = motion.basis, max(positions - 1, 1)
    if isinstance(basis, Fourier):  # a line, and two functions for each wave
        turn = (basis.interval[1] - basis.interval[0]) / 180.0 * low.harmonics if motion.axis[0] in ROTARY else 0.0
        waves = tuple(n for n in basis.harmonics if n <= max(low.degree, turn))
        basis = msgspec.structs.replace(basis, harmonics=waves[: max((most - 1) // 2, 0)])
    elif isinstance(basis, Legendre):
        basis = msgspec.structs.replace(basis, degree=min(basis.degree, low.degree, most))
    elif isinstance(basis, Harmonics):
        basis = msgspec.structs.replace(basis, order=min(basis.order, low.harmonics, max(most // 2, 1)))
    return msgspec.structs.replace(
        motion, basis=basis, parameters=motion.parameters[: basis.size], u=motion.u[: basis.size]
    )


def identifiability(fit: Fit) -> Identifiability:
    """The identifiability of the model of a fit from its data."""
    information = fit.solved.information
    null = null_space(information)
    free = gauge(fit.measurement.machine, fit.model, fit.prior)
    u, values, _ = singular_values(null @ (null.T @ free))
    conventional = np.asarray(u[:, values > 1 - ROUNDING_OF_SHARE])
    size = len(fit.prior)
    return Identifiability(
        size,
        size - null_space(fit.solved.machine_information).shape[1],
        size - null.shape[1],
        conventional.shape[1],
        tuple(_named(fit, null, conventional)),
    )


def _named(fit: Fit, null: Array, conventional: Array) -> list[Unidentifiable]:
    """The null directions that are not conventional, by the effects they lie in.

    In this order: one effect, two effects, the positioning errors of all linear axes, all others together.
    """
    effects, columns = fit.model.effects, fit.model.slices
    found: list[Unidentifiable] = []
    explained = conventional
    along = tuple(i for i, effect in enumerate(effects) if along_itself(effect))
    groups = [*combinations(range(len(effects)), 1), *combinations(range(len(effects)), 2), along]
    for members in filter(None, groups):
        part = np.concatenate([np.arange(columns[i].start, columns[i].stop) for i in members])
        inside = _inside(null, part)
        new = _beyond(inside, explained)
        if new.shape[1]:
            explained = np.concatenate([explained, new], axis=1)
            # an effect that is not determined at all contains conventional directions as well
            directions = len(part) if inside.shape[1] == len(part) else new.shape[1]
            found.append(_unidentifiable(fit, [effects[i] for i in members], directions, len(part)))
    others = _beyond(null, explained)
    if others.shape[1]:
        weight = np.linalg.norm(others, axis=1)
        mixed = [
            effect
            for effect, part in zip(effects, columns, strict=True)
            if weight[part].max(initial=0.0) > ROUNDING_OF_SHARE
        ]
        found.append(_unidentifiable(fit, mixed, others.shape[1], sum(len(effect.parameters) for effect in mixed)))
    return found


def _inside(null: Array, part: np.ndarray) -> Array:
    """The null directions `(p, k)` that have no share outside the parameters of `part`."""
    _, shares, directions = singular_values(null[part])
    return np.asarray(null @ directions[shares**2 > 1.0 - WITHIN_EFFECTS_SHARE].T)


def _beyond(directions: Array, known: Array) -> Array:
    """The part of the space of `directions` that is orthogonal to `known`, as a basis."""
    if not directions.shape[1]:
        return directions
    unknown = directions - known @ (known.T @ directions)
    u, values, _ = singular_values(unknown)
    return np.asarray(u[:, values > ROUNDING_OF_SHARE])


def _unidentifiable(fit: Fit, effects: Sequence[Effect], directions: int, parameters: int) -> Unidentifiable:
    names = tuple(effect.name for effect in effects)
    if len(effects) == 1:
        part = f"{directions} of its {parameters} shapes are "
        reason = ("" if directions == parameters else part) + "unidentifiable"
    elif len(effects) == 2:
        reason = f"only their sum is identifiable ({directions} of {parameters} shapes)"
    else:
        reason = f"{directions} {'combination' if directions == 1 else 'combinations'} of them unidentifiable"
    return Unidentifiable(names, directions, parameters, reason, _remedy(fit, effects))


def _remedy(fit: Fit, effects: Sequence[Effect]) -> str:
    """The measurement that would determine the effects."""
    measurement = fit.measurement
    vectors = np.array([target.position for target in measurement.targets.values() if target.carrier == "tool"])
    used = np.unique(measurement.target_number)
    carried = {axis.name for axis in measurement.machine.axes if axis.side == "workpiece"}
    unseen = measurement.stands_on == "bed" and len(vectors) == len(measurement.targets)
    spread = np.linalg.matrix_rank(vectors - vectors[:1]) if len(vectors) else 0
    if unseen and axes_of(effects) & carried:
        return ON_TABLE
    if measurement.across is not None and not any(effect.angular for effect in effects):
        return UNLIKE_LINES
    own = measurement.instrument.would_show(measurement, effects)
    if own:
        return own
    if measurement.instrument.components < 3:
        return "a measurement in all three directions of space would show it"
    if any(effect.angular for effect in effects) and spread < 2:
        needed = {0: "a second tool vector (two more, not in one line, for all angles)", 1: "a third tool vector"}
        return f"it needs {needed[int(spread)]} off the line of those measured"
    return "some targets were never measured" if len(used) < len(measurement.targets) else INDEPENDENT
