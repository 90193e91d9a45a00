"""Shapes proposed from the residual: periods, pitches of tables, fixed points of growth, moments of jumps.

A generalised Lomb-Scargle periodogram of the residual over the positions of an axis: each wave enters through the
observation equations of its error motion. The best waves are compared without the part that the model and the
registration can imitate. Every proposal has the number of independent tries of its search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from typing import get_args

import numpy as np

from calibration.cores import each
from calibration.diagnosis.search.candidates import Candidate
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import Projected
from calibration.diagnosis.search.shapes.change_points import about_fixed_point, breaks, turning_points
from calibration.diagnosis.search.shapes.sawtooth import likeliest, refined, teeth
from calibration.diagnosis.search.shapes.sensitivity import Errors, Sensitivity
from calibration.diagnosis.search.shapes.spectra import (
    SHORTEST,
    Waves,
    finest,
    peaks,
    resolved,
    strengths,
    usual_waves,
)
from calibration.observation.full_model import is_log, observed_components, repeated_targets
from kinematics.basis import BSpline
from kinematics.effects import (
    Component,
    Cyclic,
    ErrorMotion,
    GrowthWithDuty,
    GrowthWithSensor,
    GrowthWithTime,
    QuantisedCompensation,
    Reversal,
)
from kinematics.effects.base import own_component, unit_of
from kinematics.transforms import Array

WAVES = 8.0
"""Least number of waves over the travel: an error with fewer is a matter of the basis, not a cyclic error."""
WAVES_OF_A_LOG = 3.0
"""The same for the log of a moving axis."""
ROWS_OF_A_WAVE = 4.0
"""Least number of rows of such a log in a wave: the clock of the log does not make waves."""
OVERSAMPLING = 4
MOST_WAVES, MOST_TEETH = 10_000, 1000
"""Most frequencies of waves and of sawtooth functions that are tried."""
SCANNED = 1200
"""Most rows that a search for shapes uses."""
BEST, BEST_WAVES = 12, 120
"""Best frequencies of steps, and of waves of each error motion, that are compared without the model's part: positions
that are few, or nearly on a lattice, make many waves alike."""
TEETH = 5.5
"""Least number of steps over the travel."""
OFFSETS = 12
"""Positions of the steps within a pitch that are tried."""
MOST_HARMONICS, FEW_HARMONICS = 8, 3
"""Most harmonics of a cyclic error in data of one axis, and in points of a volume: with more it is a table of any shape
there, which imitates what depends on position and something else."""
SAME = 0.01
"""Relative difference below which two periods are the same."""
FINE = (6, 8, 12, 16, 24, 32, 48)
"""Sizes of finer bases."""
MOST = 0.5
"""Share of the squares beyond the noise that is most of them."""


def events(linearised: LinearisedFit, library: Sequence[Candidate]) -> Iterator[Candidate]:
    """Candidates of the library with moments and fixed points proposed from the residual of a linearised fit."""
    some = linearised.thinned(SCANNED)
    yield from breaks(some, linearised)
    yield from turning_points(some, linearised)
    yield from fixed_points(some, library)
    yield from reversals(some)


def dominant(linearised: LinearisedFit, library: Sequence[Candidate]) -> Iterator[Candidate]:
    """`events`, and the steps and waves that explain most of the squares beyond the noise, where these are most.

    Causes of the library would imitate such a shape one after the other.
    """
    some = linearised.thinned(SCANNED)
    yield from events(linearised, library)
    beyond = some.squares - some.degrees_of_freedom
    if beyond < some.degrees_of_freedom:
        return
    for candidate in chain(steps(some, linearised), waves(some)):
        projected = some.projected(some.columns(candidate.effect))
        if some.score(projected, candidate.shapes).squares > MOST * beyond:
            yield candidate


def proposals(linearised: LinearisedFit, library: Sequence[Candidate]) -> Iterator[Candidate]:
    """Candidates with shapes proposed from the residual of a linearised fit, in addition to those of the library."""
    some = linearised.thinned(SCANNED)
    yield from events(linearised, library)
    yield from finer(some)
    yield from steps(some, linearised)
    yield from waves(some)


def waves(linearised: LinearisedFit, components: tuple[Component, ...] = get_args(Component)) -> Iterator[Candidate]:
    """The strongest cyclic error of each axis and component, its period refined as far as the travel resolves it.

    It has the number of harmonics with the lowest delta-BIC.
    """
    along = partial(waves_of, linearised, components=components)
    return chain.from_iterable(each(along, linearised.measurement.moving))


def waves_of(linearised: LinearisedFit, axis: str, components: tuple[Component, ...]) -> list[Candidate]:
    """The strongest cyclic error of one axis and each of these components."""
    measurement = linearised.measurement
    frequencies = frequencies_of(linearised, axis)
    if len(frequencies) < OVERSAMPLING:
        return []
    seen = [c for c in components if measurement.axis is None or c in observed_components(measurement, axis)]
    found = []
    strongest = strongest_waves(linearised, axis, seen, frequencies)
    for component, (sensitivity, best, gains) in zip(seen, strongest, strict=True):
        wave = _wave(component, axis, 1.0 / float(best[int(np.argmax(gains))]), 1)
        found.append(Candidate(_with_harmonics(sensitivity, wave), 1, float(len(frequencies) * len(seen))))
    return found


def frequencies_of(linearised: LinearisedFit, axis: str) -> Array:
    """Frequencies `(m,)` of the waves along an axis that are tried, 1/mm or 1/degree."""
    measurement = linearised.measurement
    low, high = measurement.moving[axis]
    log = is_log(measurement, axis)
    waves_of, least = resolved if log else usual_waves, WAVES
    most = min(waves_of(linearised.positions(axis), high - low), MOST_WAVES / OVERSAMPLING)
    if log:
        steps = np.abs(np.diff(measurement.state.position(measurement.machine, axis)))
        least = WAVES_OF_A_LOG
        most = min(most, (high - low) / (ROWS_OF_A_WAVE * float(np.median(steps[steps > 0.0]))))
    if axis[0] in "ABC":
        most = min(most, (high - low) / SHORTEST)
    return np.asarray(np.arange(least, max(most, least), 1.0 / OVERSAMPLING) / (high - low))


def strongest_waves(
    linearised: LinearisedFit, axis: str, components: Sequence[Component], frequencies: Array
) -> Iterator[tuple[Sensitivity, Array, Array]]:
    """For each error motion of an axis the frequencies `(k,)` that explain most, refined, and their gains `(k,)`."""
    sensitivities = [Sensitivity.of(linearised, axis, component) for component in components]
    if not sensitivities:
        return
    waves = Waves.of(sensitivities[0].x, frequencies)
    strongest = strongest_of(sensitivities, components, waves)
    for sensitivity, found in zip(sensitivities, strongest, strict=True):
        yield sensitivity, *found


def strongest_of(
    sensitivities: Sequence[Sensitivity], components: Sequence[Component], waves: Waves
) -> Iterator[tuple[Array, Array]]:
    """For each sensitivity to an error motion the frequencies `(k,)` that explain most, refined, and their gains."""
    powers = strengths(sensitivities, waves)
    for component, sensitivity, power in zip(components, sensitivities, powers, strict=True):
        yield finest(sensitivity, waves, peaks(power, BEST_WAVES), unit_of(component)[1])


def _with_harmonics(sensitivity: Sensitivity, effect: Cyclic) -> Cyclic:
    """A cyclic error with the number of harmonics of the lowest delta-BIC; unchanged where its delta-BIC is positive.

    No harmonic is a cyclic error that the model has already.
    """
    if sensitivity.score(sensitivity.sizes(effect), 1).delta_bic >= 0.0:
        return effect
    model = sensitivity.linearised.fit.model
    known = [e for e in model.effects if isinstance(e, Cyclic) and e.axis == effect.axis]
    most = FEW_HARMONICS if sensitivity.linearised.measurement.axis is None else MOST_HARMONICS
    same = [k for k in range(2, most + 1) if any(_shared(effect.period / k, other) for other in known)]
    numbers = range(1, min(same, default=most + 1))
    variants = [_wave(effect.component, effect.axis, effect.period, number) for number in numbers]
    return min(variants, key=lambda variant: sensitivity.score(sensitivity.sizes(variant)).delta_bic)


def _shared(period: float, effect: Cyclic) -> bool:
    """True for the period of a cyclic error, or of one of its harmonics."""
    return any(abs(period * k / effect.period - 1.0) < SAME for k in range(1, len(effect.sine) + 1))


def overlap(one: Cyclic, other: Cyclic) -> bool:
    """True for cyclic errors of one axis and component that have a wave in common."""
    same = (one.axis, one.component) == (other.axis, other.component)
    return same and any(_shared(one.period / k, other) for k in range(1, len(one.sine) + 1))


def joined(one: Cyclic, other: Cyclic) -> Cyclic | None:
    """One cyclic error, at zero, for two of which the shorter is a harmonic of the longer; None where it is not."""
    longer, shorter = sorted((one, other), key=lambda effect: -effect.period)
    number = round(longer.period / shorter.period)
    harmonics = max(len(longer.sine), number * len(shorter.sine))
    same = abs(longer.period / shorter.period / number - 1.0) < SAME
    if (
        number < 2
        or not same
        or harmonics > MOST_HARMONICS
        or (longer.axis, longer.component) != (shorter.axis, shorter.component)
    ):
        return None
    return _wave(longer.component, longer.axis, longer.period, harmonics)


def steps(linearised: LinearisedFit, whole: LinearisedFit | None = None) -> Iterator[Candidate]:
    """The strongest sawtooth along each linear axis.

    Pitches are selected by the power of their wave, offsets by the sawtooth itself. Where the delta-BIC is negative,
    the sawtooth is refined on `whole`, the fit of all rows.
    """
    linear = [axis for axis in linearised.measurement.moving if axis[0] not in "ABC"]
    return chain.from_iterable(each(partial(steps_along, linearised, whole=whole), linear))


def steps_along(linearised: LinearisedFit, axis: str, whole: LinearisedFit | None = None) -> list[Candidate]:
    """The strongest sawtooth along one axis, in a list; `whole` as in `steps`."""
    frequencies = frequencies_of_steps(linearised, axis)
    if len(frequencies) < OVERSAMPLING:
        return []
    sensitivity = Sensitivity.of(linearised, axis, own_component(axis))
    best = strongest_steps(sensitivity, axis, Waves.of(sensitivity.x, frequencies))
    if sensitivity.score(sensitivity.sizes(best), 2).delta_bic < 0.0:
        best = refined(sensitivity if whole is None else Sensitivity.of(whole, axis, own_component(axis)), best)
    return [Candidate(best, 2, float(len(frequencies) * OFFSETS))]


def frequencies_of_steps(linearised: LinearisedFit, axis: str) -> Array:
    """Frequencies `(m,)` of the sawtooth functions along a linear axis that are tried, 1/mm."""
    low, high = linearised.measurement.moving[axis]
    count = min(linearised.measurement.distinct_positions[axis] / 2, MOST_TEETH / OVERSAMPLING)
    return np.asarray(np.arange(TEETH, max(count, TEETH), 1.0 / OVERSAMPLING) / (high - low))


def strongest_steps(sensitivity: Sensitivity, axis: str, waves: Waves) -> QuantisedCompensation:
    """The sawtooth of the frequencies of waves that explains most, not refined."""
    (strength,) = strengths([sensitivity], waves)
    shares, shapes = np.arange(OFFSETS) / OFFSETS, []
    for frequency in waves.frequencies[peaks(strength, 2 * BEST)].tolist():
        tried = teeth(sensitivity.x, 1.0 / frequency, shares / frequency)
        power = (sensitivity.along @ tried) ** 2 / np.maximum(sensitivity.squares @ tried**2, 1e-300)
        shapes.append((float(power.max()), 1.0 / frequency, float(shares[power.argmax()]) / frequency))
    _, pitches, offsets = np.array(sorted(shapes, reverse=True)[:BEST]).T
    return likeliest(sensitivity, axis, pitches, offsets)


def finer(linearised: LinearisedFit) -> Iterator[Candidate]:
    """A finer basis for each error motion: the lowest delta-BIC that also predicts better, if any does.

    None for the log of a moving axis: a fine basis would imitate its waves. None where a calibration of other data is
    the prior knowledge: its refinement has chosen the bases.
    """
    if linearised.fit.prior.ndim == 2:
        return iter(())
    motions = [motion for motion, _ in linearised.fit.model.error_motions]
    motions = [motion for motion in motions if not is_log(linearised.measurement, motion.axis)]
    return chain.from_iterable(each(partial(_finer_than, linearised), motions))


def _finer_than(linearised: LinearisedFit, motion: ErrorMotion) -> list[Candidate]:
    most = linearised.measurement.distinct_positions[motion.axis]
    sizes = [size for size in FINE if motion.basis.size < size <= most]
    variants = [Candidate(_finer(motion, size), 0, float(len(sizes)), motion.name) for size in sizes]
    sensitivity = Sensitivity.of(linearised, motion.axis, motion.component)
    errors = partial(_errors, sensitivity, variants)
    worth = [sensitivity.scored(one).delta_bic for one in linearised.once(("errors", motion.name), errors)]
    order = [i for i in np.argsort(worth).tolist() if worth[i] < 0.0]
    gains = {}
    for i in order:
        projected = linearised.once((motion.name, sizes[i]), partial(_projected, linearised, variants[i].effect))
        gains[i] = float(linearised.held_out_gains(projected).mean())
        if gains[i] > 0.0:
            return [variants[i]]
    best = max(gains, key=lambda i: gains[i], default=0)
    return variants[best : best + 1]


def _errors(sensitivity: Sensitivity, variants: Sequence[Candidate]) -> list[Errors]:
    return [sensitivity.response.errors(sensitivity.sizes(each.effect)) for each in variants]


def _projected(linearised: LinearisedFit, effect: ErrorMotion) -> Projected:
    return linearised.projected(linearised.columns(effect))


def fixed_points(linearised: LinearisedFit, candidates: Sequence[Candidate]) -> Iterator[Candidate]:
    """Growths of an axis from the fixed point that the data show, instead of the axis' zero."""
    for candidate in candidates:
        effect = candidate.effect
        if (
            isinstance(effect, (GrowthWithSensor, GrowthWithTime, GrowthWithDuty))
            and len(effect.parameter_table) == candidate.shapes + 1
            and (moved := about_fixed_point(linearised, effect)) is not None
        ):
            yield Candidate(moved, candidate.shapes + 1, candidate.trials)


def reversals(linearised: LinearisedFit) -> Iterator[Candidate]:
    """A difference between forward and backward of each error motion with a node at each target of repeated runs."""
    measurement = linearised.measurement
    for motion, _ in linearised.fit.model.error_motions:
        if repeated_targets(measurement, motion.axis):
            zero = (0.0,) * motion.basis.size
            yield Candidate(Reversal(motion.component, motion.axis, motion.basis, zero))


def _wave(component: Component, axis: str, period: float, harmonics: int) -> Cyclic:
    zero = (0.0,) * harmonics
    return Cyclic(component=component, axis=axis, period=period, sine=zero, cosine=zero)


def _finer(effect: ErrorMotion, size: int) -> ErrorMotion:
    basis = BSpline(tuple(np.linspace(*effect.basis.interval, size).tolist()), 3)
    zero = (0.0,) * basis.size
    return ErrorMotion(effect.component, effect.axis, basis, zero, u=zero)
