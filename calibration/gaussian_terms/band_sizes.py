"""The likeliest sizes of the bands of error motions, whose logarithms have one Gaussian prior.

Sizes of one axis and kind of error motion are alike, more so in bands of near degrees, and so are those of all linear
axes, of all rotary axes, and of the machine: a band of which the data show little is expected to be as the others are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calibration.gaussian_terms.geometry import FIT_BANDS, Bands, Key
from calibration.gaussian_terms.posterior import Equations, Posterior
from calibration.observation.full_model import ROTARY
from kinematics.error_model.priors import Priors
from kinematics.transforms import Array

OCTAVES_ALIKE = 1.0
"""Distance of bands, in octaves of the degree, over which the correlation of their sizes falls to 1 / e."""
DEGREE_OF_CONSTANT = 0.5
"""Degree at which a constant counts: an octave below a slope."""
MOST_NEWTON_STEPS, LONGEST_STEP, SETTLED_LOG_SIZE, SHORTEST_SHARE = 40, 2.0, 1e-4, 1e-3
"""Newton's steps: most of them, the longest one and the one at which they end, in the logarithm of a size, and the
least share of a step that is tried."""


class Likeliest(NamedTuple):
    """The likeliest sizes of the bands, and how well they are known."""

    sizes: Array
    """In prior sizes."""
    covariance: Array
    """Covariance `(free, free)` of the logarithms of the sizes that are fitted."""
    moves: Array
    """Derivatives `(p, free)` of the coefficients by these logarithms."""
    root_mean_squares: Array
    """Root mean squares of the sizes: the mean square of a size is larger than its likeliest square."""
    log_prior: float
    """Log of the share of their prior that the data leave, and of the density there (Laplace)."""


def likeliest(equations: Equations, bands: Bands, priors: Priors, factor: float, first: Array) -> Likeliest:
    """The likeliest sizes of the bands for white observations of a variance factor, by Newton's steps."""
    free = np.flatnonzero(~bands.fixed)
    if not len(free):
        return Likeliest(first, np.zeros((0, 0)), np.zeros((bands.width, 0)), first, 0.0)
    precision = np.asarray(np.linalg.inv(covariance_of_logs([bands.keys[number] for number in free], priors)))
    of_bands = (bands.bands[:, None] == free).astype(float)

    def sized(logs: Array) -> Array:
        sizes = first.copy()
        sizes[free] = np.exp(logs)
        return sizes

    def at(logs: Array) -> tuple[float, Posterior]:
        posterior = Posterior.of(equations, sized(logs)[bands.bands], factor)
        evidence = -0.5 * (posterior.misfit + posterior.log_determinant)
        return evidence - 0.5 * float(logs @ precision @ logs), posterior

    logs = np.log(first[free])
    value, posterior = at(logs)
    for _ in range(MOST_NEWTON_STEPS):
        slope, covariance = _slope_and_covariance(posterior, of_bands, precision)
        step = covariance @ (slope - precision @ logs)
        share = min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        trial = at(logs + share * step)
        while trial[0] < value and share > SHORTEST_SHARE:
            share /= 2.0
            trial = at(logs + share * step)
        logs, (value, posterior) = logs + share * step, trial
        if float(np.abs(share * step).max()) < SETTLED_LOG_SIZE:
            break
    _, covariance = _slope_and_covariance(posterior, of_bands, precision)
    unit, spread = posterior.mean / posterior.sizes, posterior.root.T @ posterior.root
    moves = 2.0 * posterior.sizes[:, None] * (spread @ (of_bands * unit[:, None]))
    root_mean_squares = sized(logs)
    root_mean_squares[free] *= np.exp(np.diag(covariance))
    left = float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(precision)[1])
    log_prior = 0.5 * (left - float(logs @ precision @ logs))
    return Likeliest(sized(logs), covariance, moves, root_mean_squares, log_prior)


def _slope_and_covariance(posterior: Posterior, of_bands: Array, precision: Array) -> tuple[Array, Array]:
    """Slope `(free,)` of the log evidence along the logarithms of the sizes, and their posterior covariance (Laplace).

    With the coefficients u in their prior sizes, of covariance C, and K = 1 - C: the slope of a band is the sum of
    u^2 - K over its coefficients. The second derivative between bands b and c is 2 |K_bc|^2 - 4 u_b' K_bc u_c, and
    twice the slope more on the diagonal. Where the curvature is none of a maximum, its absolute value guides the step.
    """
    unit, known = posterior.mean / posterior.sizes, np.eye(len(of_bands)) - posterior.root.T @ posterior.root
    slope, along = of_bands.T @ (unit**2 - np.diag(known)), of_bands * unit[:, None]
    second = 2.0 * np.diag(slope) - 4.0 * along.T @ known @ along + 2.0 * of_bands.T @ known**2 @ of_bands
    values, vectors = np.linalg.eigh(precision - second)
    curvature = np.maximum(np.abs(values), np.linalg.eigvalsh(precision)[0])
    return np.asarray(slope), np.asarray((vectors / curvature) @ vectors.T)


def covariance_of_logs(keys: Sequence[Key], priors: Priors) -> Array:
    """Prior covariance `(bands, bands)` of the logarithms of the sizes of bands with these keys."""
    edges = (FIT_BANDS[number] for _, _, number in keys)
    octaves = np.log2([np.sqrt(low * high) or DEGREE_OF_CONSTANT for low, high in edges])
    same = np.array([[one[:2] == other[:2] for one in keys] for other in keys], bool)
    near = np.exp(-np.abs(octaves[:, None] - octaves) / OCTAVES_ALIKE)
    rotary = np.array([key[0][0] in ROTARY for key in keys], bool)
    of_axes = priors.size_of_axes**2 * (rotary[:, None] == rotary)
    of_motion = same * (priors.size_of_motion**2 + priors.size_of_band**2 * near)
    return np.asarray(priors.size_of_machine**2 + of_axes + of_motion)
