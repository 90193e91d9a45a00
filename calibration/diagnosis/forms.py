"""Terms of effects: the columns of their linear parameters, in typical sizes.

An effect with a fixed point has a second form: two columns for each parameter leave open which position of its axis
stays where it is. They belong to two effects, fixed in the middle and at the end of the travel.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import replace

import msgspec
import numpy as np

from calibration.diagnosis.contract import contract_kind, family_of, where
from calibration.diagnosis.library.changes import at_zero
from calibration.gaussian_terms.geometry import motions, prior_sizes
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.term import Along, Term
from calibration.observation.full_model import repeated_targets
from kinematics.basis import Basis, BSpline, Legendre
from kinematics.effects import Effect, ErrorMotion, Reversal
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

CHANGED_DEGREE = 6
"""Degree of a change of an error motion: wear and a new shape of a guide are long waves."""
Form = Callable[[Observations, Effect], Term]
"""Makes a term of an effect."""


def plain(observations: Observations, effect: Effect, shares: Array | float = 1.0) -> Term:
    """The term of an effect: a column for each linear parameter.

    shares `(parameters,)`: expected sizes, as shares of the typical ones.
    """
    return _term(observations, effect, effect.name, (effect,), np.diag(_typical(observations, effect) * shares))


def pivoted(observations: Observations, effect: Effect) -> Term:
    """The term of an effect with a fixed point, about any position of its axis.

    Two columns for each linear parameter: about the middle of the travel, and the change of this by moving the fixed
    point by half of the travel.
    """
    axis = effect.axes[0]
    low, high = observations.measurement.moving[axis]
    middle, end = (msgspec.structs.replace(effect, fixed_point=point) for point in ((low + high) / 2.0, high))
    size = np.diag(_typical(observations, effect))
    mixed = np.block([[size, -size], [np.zeros_like(size), size]])
    return _term(observations, middle, f"{effect.name} about any {axis}", (middle, end), mixed)


def _typical(observations: Observations, effect: Effect) -> Array:
    """Typical sizes of the linear parameters, for the kind of machine where the effect acts in it."""
    times = observations.priors.typical if effect.ACTS_ON != "instrument" else 1.0
    return times * np.array([size for size, linear in zip(effect.typical, effect.linear, strict=True) if linear])


def _term(observations: Observations, effect: Effect, name: str, effects: Sequence[Effect], parameters: Array) -> Term:
    own = tuple(map(at_zero, effects))
    return Term(
        name,
        contract_kind(effect),
        family_of(effect),
        made_of(observations, own, parameters),
        parameters.shape[1],
        own,
        parameters,
        where(effect),
    )


def of_others(
    observations: Observations, term: Term, effects: tuple[Effect, ...], finer: Callable[[], Sequence[Term]]
) -> Term:
    """The term of other effects in the place of those of a term, from which they differ by a moment or a period."""
    assert term.parameters is not None
    arm = term.make.name if isinstance(term.make, Along) else None
    return replace(term, make=_made(observations, effects, term.parameters, arm), effects=effects, finer=finer)


def together(terms: Sequence[Term]) -> Iterator[Term]:
    """Terms of causes that are equal but for their place: in X, Y and Z of the tool, or of each axis.

    One that is hidden by another cause, or by the others, in each single place is seen as a whole.
    """
    places: dict[Hashable, list[Term]] = {}
    for term in terms:
        for effect in term.effects if term.named and len(term.effects) == 1 else ():
            if (place := _place(effect)) is not None:
                values = msgspec.structs.asdict(effect) | {place: None}
                places.setdefault((type(effect), *values.values()), []).append(term)
    yield from (_whole(parts) for parts in places.values() if len(parts) > 1)


def _place(effect: Effect) -> str | None:
    """The field of an effect that states its place; None where it has none, or more than one."""
    component = getattr(effect, "component", None)
    if component in ("X", "Y", "Z") and not effect.axes:
        return "component"
    alone = hasattr(effect, "axis") and len(effect.axes) == 1 and component is None and not effect.PERIODIC
    return "axis" if alone else None


def _whole(parts: Sequence[Term]) -> Term:
    """The term of one cause in several places."""
    first = parts[0]

    def make() -> Array:
        return np.concatenate([part.make() for part in parts], axis=2)

    def finer() -> list[Term]:
        each = (part.finer() for part in parts if part.finer is not None)
        return [_whole(some) for some in zip(*each, strict=True)]

    name = f"{first.kind} {'+'.join(str(part.where) for part in parts)}"
    width = sum(part.width for part in parts)
    effects = tuple(effect for part in parts for effect in part.effects)
    family, prior = (first.kind, "everywhere"), first.log_prior
    return Term(name, first.kind, family, make, width, effects, log_prior=prior, finer=finer, parts=tuple(parts))


def reversals(observations: Observations) -> Iterator[Term]:
    """Terms of differences of error motions between forward and backward, of axes that are observed one at a time.

    They are as smooth as error motions; at targets that are visited again and again also a mean and any difference.
    """
    measurement = observations.measurement
    for motion, degrees in motions(measurement) if measurement.axis_rows else ():
        smooth = np.diag(1.0 / np.maximum(degrees, 1) ** observations.priors.smoothness)
        yield _reversal(observations, motion, motion.basis, smooth)
        if nodes := repeated_targets(measurement, motion.axis):
            each = np.concatenate([np.ones((len(nodes), 1)), np.eye(len(nodes))], axis=1)
            yield _reversal(observations, motion, BSpline(tuple(nodes), 1), each)


def _reversal(observations: Observations, motion: ErrorMotion, basis: Basis, shares: Array) -> Term:
    """The term of a difference, of coefficients with expected sizes `(basis.size, width)`, in typical sizes."""
    effect = Reversal(motion.component, motion.axis, basis, (0.0,) * basis.size)
    return _term(observations, effect, effect.name, (effect,), _typical(observations, effect)[:, None] * shares)


def motion_changes(observations: Observations, calibration: ErrorModel) -> Iterator[Term]:
    """Terms of the error motions of a calibration, whose course may have changed beyond a line."""
    for motion, _ in calibration.error_motions:
        arc = observations.measurement.moving.get(motion.axis)
        if arc is None:
            continue
        basis = Legendre(arc, CHANGED_DEGREE)
        effect = ErrorMotion(motion.component, motion.axis, basis, (0.0,) * basis.size)
        degrees = np.arange(basis.size)
        sizes = np.where(degrees > 1, prior_sizes(degrees, observations.priors), 0.0)
        yield _term(observations, effect, f"change of {effect.name}", (effect,), np.diag(sizes)[:, degrees > 1])


def made_of(observations: Observations, effects: Sequence[Effect], parameters: Array) -> Callable[[], Array]:
    """Makes the columns of coefficients that give the linear parameters of effects, by `parameters @`.

    Along one arm where the effects are one error of the machine, the same in all rows.
    """
    machine = observations.measurement.machine
    errors = [each for effect in effects for each in effect.columns(machine, observations.first_state)]
    numbers = {6 * (each.column % (len(machine.axes) + 2)) + each.component for each in errors}
    alone = len(numbers) == 1 and len(errors) == len(effects)
    return _made(observations, effects, parameters, numbers.pop() if alone else None)


def _made(
    observations: Observations, effects: Sequence[Effect], parameters: Array, arm: Hashable | None
) -> Callable[[], Array]:
    """As `made_of`; arm: number of the error of the machine that the effects are, None where they are several."""
    machine, state = observations.measurement.machine, observations.measurement.state
    linear = np.concatenate([effect.linear for effect in effects])

    def functions() -> Array:
        each = [own.values for effect in effects for own in effect.columns(machine, state)]
        return np.asarray(np.concatenate(each, axis=1)[:, linear] @ parameters)

    if isinstance(arm, int):
        return observations.along(arm, functions)
    return lambda: np.asarray(observations.columns(effects)[:, :, linear] @ parameters)
