"""A fit without a choice of bases: sizes of bands by a Gaussian prior of their logarithms, two bases as rivals.

The error motions of `calibration/gaussian_terms`, with four differences. Constants and slopes are bands of their own.
The logarithms of all sizes have one Gaussian prior, of which the likeliest ones are found by Newton's steps. The
uncertainty contains that of the sizes. Legendre polynomials, and waves over 1.25 travels, are rival structures, and
the result is their mixture by their posterior odds.

    python benchmarks/log_sizes.py [--draws 20] [--seed 5501]    # machines of `benchmarks/virtual_fits.py`
    python benchmarks/fit_and_terms.py                           # files of the third exam

Both compare it with `ncomp fit`, on the same data.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, cast

import msgspec
import numpy as np
from scipy.linalg import block_diag

import machines
from benchmarks.virtual_fits import CASES, measure
from calibration.evaluation.volumetric import aligned, deviation_on
from calibration.fit.calibrate import calibrate
from calibration.gaussian_terms.calibrated import machine_model
from calibration.gaussian_terms.geometry import (
    ERROR_DEGREE,
    TURN_HARMONICS,
    Bands,
    Geometry,
    Key,
    degrees_of,
    kind_of,
)
from calibration.gaussian_terms.linearised import SETTLED_OBSERVATIONS, change_of, mean_errors
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.posterior import Equations, Posterior
from calibration.gaussian_terms.structure import Data, Structure
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import ROTARY, BasisChoice, axis_motions, least_priors
from calibration.planning.strategies import evaluation_grid
from calibration.simulation.true_model import random_true_model
from kinematics.effects import Effect, ErrorMotion
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.turn import gap_of

EDGES = ((0, 0), (1, 1), (2, 3), (4, 6), (7, 10), (11, 15), (16, 22))
"""First and last degree of each band; a constant and a slope are bands of their own."""
LEVEL, AXES, CLASS, BAND = 1.0, 1.0, 0.7, 0.7
"""Standard deviations of the logarithms of sizes: common to the machine, to its linear or its rotary axes, to an axis
and kind of error motion, and of a band."""
OCTAVE = 1.0
"""Distance of bands, in octaves of the degree, over which the correlation of their sizes falls to 1 / e."""
WIDER = 1.25
"""Period of the longest cosine with its mirror image, in two travels: errors need not be even about the ends."""
FINE = 44
"""Degree of the polynomials in which both bases are written."""
CONSTANT, ASSEMBLED = 0.5, -4
"""Degree at which a constant counts, and the number of the band of parameters with a least prior size."""
LEAST_UM = 1e-3
"""Least prior size of a parameter, um or urad: a datum needs one of those, too, that a basis leaves at 0."""
STEPS, ROUNDS, PASSES = 40, 5, 4
"""Most steps of the sizes, rounds of sizes and noise, and linearisations."""
LEGENDRE, WAVES = "legendre", "waves"


@dataclass(frozen=True)
class Found:
    """A structure with one of the bases."""

    geometry: Geometry
    structure: Structure
    mean: Array
    """Parameters `(P,)` of the effects."""
    covariance: Array
    """`(P, P)`, with the uncertainty of the sizes."""
    prior: Array
    """Prior sizes `(P,)` of the parameters."""
    log_posterior: float
    """Up to a constant of the data; over all sizes, by Laplace."""


class Likeliest(NamedTuple):
    """The likeliest sizes of the bands."""

    sizes: Array
    covariance: Array
    """Of the logarithms of the free ones."""
    free: np.ndarray
    """Numbers of the bands whose sizes are free."""
    moves: Array
    """Derivatives `(p, free)` of the coefficients by the logarithms."""
    log_posterior: float
    """Of the observations at these sizes, and the Laplace integral over them."""


def mixture(measurement: Measurement, bases: Sequence[str] = (LEGENDRE, WAVES)) -> ErrorModel:
    """The calibration by the mixture of the bases."""
    found = [explained(measurement, basis) for basis in bases]
    odds = np.array([each.log_posterior for each in found])
    share = np.exp(odds - odds.max())
    share /= share.sum()
    mean = np.sum([own * each.mean for own, each in zip(share, found, strict=True)], axis=0)
    covariance = np.sum(
        [
            own * (each.covariance + np.outer(each.mean - mean, each.mean - mean))
            for own, each in zip(share, found, strict=True)
        ],
        axis=0,
    )
    likelier = found[int(np.argmax(odds))]
    own = likelier.structure.data.observations.measurement
    return machine_model(own, likelier.geometry.effects, mean, covariance, likelier.prior)


def explained(measurement: Measurement, basis: str) -> Found:
    """The structure with a basis, its sizes, its noise and its outliers."""
    observations = Observations.of(measurement)
    for _ in range(PASSES):
        found = _explained(observations, basis)
        again = observations.about(mean_errors(found.structure))
        if measurement.instrument.MAY_BE_FEW or change_of(found.structure, again) < SETTLED_OBSERVATIONS:
            break
        observations = again
    return found


def _explained(observations: Observations, basis: str) -> Found:
    always, known = geometry(observations, basis)
    structure = Structure.first(Data.of(observations, always=always))
    found = likeliest(structure.equations, always.bands, known, structure.noise.factor, structure.band_sizes)
    for _ in range(0 if observations.measurement.instrument.MAY_BE_FEW else ROUNDS):
        structure = structure.resized(found.sizes).with_noise()
        found = likeliest(structure.equations, always.bands, known, structure.noise.factor, found.sizes)
    structure = structure.resized(found.sizes)
    # the mean of the square of a size is larger than its likeliest value
    wider = found.sizes.copy()
    wider[found.free] *= np.exp(np.diag(found.covariance))
    covariance = structure.resized(wider).posterior.covariance + found.moves @ found.covariance @ found.moves.T
    matrix, noise = always.parameters, structure.noise
    lost = structure.priors.left_out * np.count_nonzero(noise.left_out)
    of_noise = sum(float(np.log1p((s / structure.priors.non_repeatability_um) ** 2)) for s in noise.repeats.values())
    white = structure.whitener
    whole = white.log_volume - 0.5 * white.scalars * float(np.log(noise.factor)) - lost - of_noise
    return Found(
        always,
        structure,
        always.values(structure.posterior.mean),
        matrix @ covariance @ matrix.T,
        np.maximum(np.linalg.norm(matrix * wider[always.bands], axis=1), LEAST_UM),
        found.log_posterior + float(whole),
    )


def geometry(observations: Observations, basis: str) -> tuple[Geometry, list[Key]]:
    """The error motions of the axes in a basis, and the key of each of their bands."""
    parts = list(_parts(observations, basis))
    effects = tuple(part[0] for part in parts)
    matrix = block_diag(*(part[1] for part in parts))
    keys = [key for part in parts for key in part[2]]
    always = Geometry(
        **vars(Bands.of(keys, observations.priors)),
        effects=effects,
        columns=observations.columns(effects) @ matrix,
        parameters=matrix,
        before=np.zeros(len(matrix)),
    )
    return always, list(dict.fromkeys(keys))


def _parts(observations: Observations, basis: str) -> Iterator[tuple[Effect, Array, list[Key]]]:
    """Each effect, its parameters by the coefficients of its columns, and the keys of these."""
    measurement, priors = observations.measurement, observations.priors
    for axis, arc in measurement.moving.items():
        own = measurement.machine.axes[measurement.machine.index(axis)]
        closed = own.turns_fully and not gap_of(arc)
        choice = BasisChoice("fourier", TURN_HARMONICS) if closed else BasisChoice("legendre", FINE)
        for motion in axis_motions(measurement, axis, choice):
            size = len(motion.parameters)
            degrees = degrees_of(size if closed else ERROR_DEGREE + 1, closed=closed)
            shapes = WAVES_IN_LEGENDRE if basis == WAVES and not closed else np.eye(size)[:, : len(degrees)]
            matrix = shapes * (priors.error_motion_um / np.maximum(degrees, 1) ** priors.smoothness)
            kind = kind_of(cast(ErrorMotion, motion))
            keys = [(axis, kind, _band(degree)) for degree in degrees.tolist()]
            least = least_priors(
                measurement, msgspec.structs.replace(no_errors(measurement.machine), effects=(motion,))
            )
            assembled = np.flatnonzero(least > 0.0)
            kept = np.setdiff1d(np.arange(len(keys)), assembled)
            matrix = np.concatenate([matrix[:, kept], np.eye(size)[:, assembled] * least[assembled]], axis=1)
            yield motion, matrix, [keys[k] for k in kept] + [(motion.name, "", ASSEMBLED)] * len(assembled)


def _waves() -> Array:
    """Coefficients `(FINE + 1, DEGREE + 1)` of a constant, a slope, and cosines over WIDER travels."""
    x, weights = np.polynomial.legendre.leggauss(200)
    polynomials = np.polynomial.legendre.legvander(x, FINE)
    cosines = [np.cos(np.pi * k * (x + WIDER) / (2.0 * WIDER)) for k in range(2, ERROR_DEGREE + 1)]
    functions = np.stack([np.ones_like(x), x, *cosines], axis=1)
    squares = 2.0 / (2.0 * np.arange(FINE + 1) + 1.0)
    return np.asarray((polynomials * weights[:, None]).T @ functions / squares[:, None])


WAVES_IN_LEGENDRE = _waves()


def _band(degree: int) -> int:
    return next(number for number, (low, high) in enumerate(EDGES) if low <= degree <= high)


def prior_of(known: Sequence[Key]) -> tuple[np.ndarray, Array]:
    """Numbers of the bands whose sizes are free, and the covariance of the logarithms of these."""
    free = np.array([number for number, key in enumerate(known) if key[2] >= 0], int)
    keys = [known[number] for number in free]
    octaves = np.log2([np.sqrt(low * high) or CONSTANT for low, high in (EDGES[key[2]] for key in keys)])
    same = np.array([[a[:2] == b[:2] for a in keys] for b in keys], bool).reshape(len(keys), len(keys))
    near = np.exp(-np.abs(octaves[:, None] - octaves) / OCTAVE)
    rotary = np.array([key[0][0] in ROTARY for key in keys], bool)
    alike = rotary[:, None] == rotary
    return free, LEVEL**2 + AXES**2 * alike + same * (CLASS**2 + BAND**2 * near)


def likeliest(equations: Equations, bands: np.ndarray, known: Sequence[Key], factor: float, first: Array) -> Likeliest:
    """The likeliest sizes, by Newton's steps from the first ones.

    With the coefficients u in their prior sizes, of covariance C, and K = 1 - C: the slope of the log evidence along
    the logarithm of the size of a band is the sum of u^2 - K over its coefficients. Its second derivative between
    bands b and c is 2 |K_bc|^2 - 4 u_b' K_bc u_c, and twice the slope more on the diagonal.
    """
    free, covariance = prior_of(known)
    precision = np.linalg.inv(covariance)
    of_bands = np.zeros((len(bands), len(known)))
    of_bands[np.arange(len(bands)), bands] = 1.0
    of_bands = of_bands[:, free]

    def sized(logs: Array) -> Array:
        sizes = first.copy()
        sizes[free] = np.exp(logs)
        return sizes

    def at(logs: Array) -> tuple[float, Posterior]:
        posterior = Posterior.of(equations, sized(logs)[bands], factor)
        own = -0.5 * (posterior.misfit + posterior.log_determinant) - 0.5 * float(logs @ precision @ logs)
        return own, posterior

    logs = np.log(first[free])
    value, posterior = at(logs)
    for _ in range(STEPS):
        unit, spread = posterior.mean / posterior.sizes, posterior.root.T @ posterior.root
        known_share = np.eye(len(unit)) - spread
        slope = of_bands.T @ (unit**2 - np.diag(known_share))
        along = of_bands * unit[:, None]
        second = (
            2.0 * np.diag(slope) - 4.0 * along.T @ known_share @ along + 2.0 * of_bands.T @ known_share**2 @ of_bands
        )
        values, vectors = np.linalg.eigh(precision - second)
        curvature = np.maximum(np.abs(values), 1.0 / np.linalg.norm(covariance, 2))
        step = vectors @ ((vectors.T @ (slope - precision @ logs)) / curvature)
        step *= min(1.0, 2.0 / max(float(np.abs(step).max(initial=0.0)), 1e-12))
        share, trial = 1.0, at(logs + step)
        while trial[0] < value and share > 1e-3:
            share /= 2.0
            trial = at(logs + share * step)
        moved = float(np.abs(share * step).max(initial=0.0))
        logs, (value, posterior) = logs + share * step, trial
        if moved < 0.02:
            break
    unit, spread = posterior.mean / posterior.sizes, posterior.root.T @ posterior.root
    moves = 2.0 * posterior.sizes[:, None] * (spread @ (of_bands * unit[:, None]))
    volume = -0.5 * float(np.linalg.slogdet(covariance)[1] + np.log(curvature).sum())
    return Likeliest(sized(logs), (vectors / curvature) @ vectors.T, free, moves, value + volume)


def by_fit(measurement: Measurement) -> ErrorModel:
    """The calibration of `ncomp fit`, without its held-out test."""
    return calibrate(measurement, hold_out=False, force=True).fit.model


METHODS: dict[str, Callable[[Measurement], ErrorModel]] = {
    "fit": by_fit,
    LEGENDRE: partial(mixture, bases=(LEGENDRE,)),
    WAVES: partial(mixture, bases=(WAVES,)),
    "mixture": mixture,
}


def judged(name: str, seed: int, draw: int) -> dict[str, tuple[float, float, float]]:
    """Of each method: RMS of what it leaves on a grid, um; the share within 1.96 u; and processor time, s."""
    case, rng = CASES[name], np.random.default_rng([seed, draw])
    machine = machines.load(case.machine)
    truth = random_true_model(machine, rng)
    measurement, tool = measure(case, machine, truth, rng), next(iter(case.targets.values())).position
    grid, found = evaluation_grid(machine, 5), {}
    wanted, points = deviation_on(machine, truth, grid, tool)
    transform = error_transform_with_tool(machine, grid, tool)[:, :3]
    for method, calibration in METHODS.items():
        start = time.process_time()
        model = calibration(measurement)
        seconds = time.process_time() - start
        error = aligned(deviation_on(machine, model, grid, tool)[0] - wanted, points)
        design = model.design(machine, State(grid), transform)
        columns = np.stack([aligned(design[:, :, k], points) for k in range(design.shape[2])], axis=2)
        u = np.sqrt(np.einsum("ndp,pq,ndq->nd", columns, np.array(model.covariance), columns, optimize=True))
        left = 1e3 * float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
        found[method] = left, float(np.mean(np.abs(error) < 1.96 * u)), seconds
    return found


def main() -> None:
    """Print a table for each machine."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--seed", type=int, default=5501)
    given = parser.parse_args()
    for name in CASES:
        found = [judged(name, given.seed, draw) for draw in range(given.draws)]
        print(f"{name:10} {'left, um':>9} {'covered':>8} {'lowest':>7} {'s, median':>10}")
        for method in METHODS:
            left, covered, seconds = np.array([each[method] for each in found]).T
            numbers = f"{left.mean():9.2f} {100 * covered.mean():6.1f} % {100 * covered.min():5.0f} %"
            print(f"{method:10} {numbers} {np.median(seconds):10.2f}", flush=True)


if __name__ == "__main__":
    main()
