"""Sawtooth errors from the steps of a compensation table: search for pitch and offset, and their uncertainties.

A jump has no derivative that a fit could follow, and may lie anywhere between two positions: the odds have many
maxima.
"""

from __future__ import annotations

import numpy as np

from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.shapes.sensitivity import Sensitivity
from kinematics.effects import QuantisedCompensation
from kinematics.effects.base import own_component
from kinematics.transforms import Array

PITCHES, OFFSETS = 61, 41
"""Pitches and offsets that are tried about a sawtooth."""
CLOSER = 8
"""Factor by which the next round is finer."""
ROUNDS = 3
ALL = 0.999
"""Least share of the odds in the range of the next round."""
_NEXT = tuple(slice(n // 2 - n // 2 // CLOSER, n // 2 + n // 2 // CLOSER + 1) for n in (OFFSETS, PITCHES))
OVER = 3_000_000
"""Most positions times sawtooth functions that are computed together."""


def teeth(x: Array, pitches: Array | float, offsets: Array | float) -> Array:
    """Sawtooth functions `(n, k)` of height 1 at positions `(n,)`."""
    turns = x[:, None] - offsets
    turns /= pitches
    turns -= np.floor(turns)
    return np.subtract(0.5, turns, out=turns)


def likeliest(sensitivity: Sensitivity, axis: str, pitches: Array, offsets: Array) -> QuantisedCompensation:
    """The sawtooth along an axis, of these pitches and offsets `(k,)`, that explains most; its step at zero.

    sensitivity: of the axis in its own direction.
    """
    best = int(np.argmax(_gains(sensitivity, pitches, offsets)))
    pitch = float(pitches[best])
    return QuantisedCompensation(axis=axis, step=0.0, pitch=pitch, offset=float(offsets[best]) % pitch)


def refined(sensitivity: Sensitivity, effect: QuantisedCompensation) -> QuantisedCompensation:
    """The likeliest sawtooth near this one; sensitivity: of its axis in its own direction."""
    for k in range(ROUNDS):
        effect = likeliest(sensitivity, effect.axis, *_about(sensitivity.linearised, effect, CLOSER**-k))
    return effect


def saw_uncertainty(linearised: LinearisedFit, effect: QuantisedCompensation) -> tuple[float, float]:
    """Standard uncertainties of pitch and offset: RMS distances from those of the effect, by the odds of all others.

    linearised: the fit without the effect.
    """
    sensitivity = Sensitivity.of(linearised, effect.axis, own_component(effect.axis))
    for k in range(ROUNDS):
        pitches, offsets = _about(linearised, effect, CLOSER**-k)
        apart = pitches[1] - pitches[0], offsets[PITCHES] - offsets[0]
        gains = _gains(sensitivity, pitches, offsets)
        variance = max((linearised.squares - float(gains.max())) / linearised.degrees_of_freedom, 1.0)
        odds = np.exp((gains - gains.max()) / (2.0 * variance))
        odds /= odds.sum()
        away = pitches - effect.pitch, offsets - effect.offset
        u_pitch, u_offset = (float(np.sqrt(odds @ distance**2)) for distance in away)
        if odds.reshape(OFFSETS, PITCHES)[_NEXT].sum() < ALL:
            break
    # the spacing of the trials adds the variance of a uniform distribution
    return float(np.hypot(u_pitch, apart[0] / 12**0.5)), float(np.hypot(u_offset, apart[1] / 12**0.5))


def _about(linearised: LinearisedFit, effect: QuantisedCompensation, reach: float) -> tuple[Array, Array]:
    """Pitches and offsets `(OFFSETS * PITCHES,)` about those of an effect; a new pitch keeps the jump in mid-travel.

    reach: 1 for one step more or less over the travel, and half a pitch to either side.
    """
    low, high = linearised.measurement.moving[effect.axis]
    jumps = round(((low + high) / 2 - effect.offset) / effect.pitch)
    alias = effect.pitch**2 / (high - low)
    pitch = effect.pitch + reach * alias * np.linspace(-1.0, 1.0, PITCHES)
    middle = effect.offset + jumps * effect.pitch + reach * effect.pitch * np.linspace(-0.5, 0.5, OFFSETS)
    middles, pitches = (part.reshape(-1) for part in np.meshgrid(middle, pitch, indexing="ij"))
    return pitches, middles - jumps * pitches


def _gains(sensitivity: Sensitivity, pitches: Array, offsets: Array) -> Array:
    """Reduction of the sum of squares by each sawtooth `(k,)`."""
    x = sensitivity.x
    size = max(1, OVER // len(x))
    parts = [slice(start, start + size) for start in range(0, len(pitches), size)]
    return np.concatenate([sensitivity.gains(teeth(x, pitches[part], offsets[part])) for part in parts])
