"""A chunk of draws of one case: the unit of work, with the same outcome in any process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibration.design.basis_draws import automatic_parts, chosen, stated_sizes, with_other_effects
from calibration.design.equations import Columns, Sample, sample
from calibration.design.layout import Setup
from calibration.design.solver import Fits, Sizes
from calibration.fit.linear import Part
from calibration.fit.set_up.explained import AUTO
from calibration.observation.full_model import stated_bases
from calibration.study.cases import Case
from kinematics.effects.geometric import TYPICAL_MOTION_UM
from kinematics.transforms import Array
from kinematics.user_error import UserError

DRAWS_OF_CHUNK = 50
"""Number of draws of a chunk; the last of a case may have fewer."""
MACHINES, NOISE = 0, 1
"""Streams of random numbers, common to all cases: these measure the same machines and differ only in the method."""


class Chunk(NamedTuple):
    """Number of a chunk, and number of its draws."""

    number: int
    draws: int


class Outcome(NamedTuple):
    """RMS errors of the draws of a chunk."""

    before: Array
    """RMS errors `(volumes, draws)`, um, without a correction."""
    after: Array
    """RMS errors `(volumes, draws)`, um, after correction by the fits."""


@dataclass(frozen=True)
class Prepared:
    """A case with everything that all its draws share."""

    case: Case
    setup: Setup
    fits: Fits
    parts: tuple[Part, ...]
    """The parts of the model of all draws."""
    sizes: Sizes | None
    """Sizes of their parameters in all draws; None where each draw decides its own."""

    @classmethod
    def of(cls, case: Case) -> Prepared:
        """The case with its designs."""
        setup = case.setup()
        fits = Fits(Columns(setup, case.volumes, case.other_effects), case.true_models)
        prior = case.fit.prior
        scale = None if prior == "auto" else np.inf if prior == "none" else float(prior) / TYPICAL_MOTION_UM
        return cls(case, setup, fits, *_parts_and_sizes(case, fits, scale))

    def sample(self, chunk: Chunk) -> Sample:
        """The virtual machines of a chunk and their observations."""
        streams = [
            np.random.default_rng(np.random.SeedSequence(self.case.seed, spawn_key=(chunk.number, stream)))
            for stream in (MACHINES, NOISE)
        ]
        coefficients = self.case.true_models.draw(streams[0], chunk.draws)
        return sample(self.setup, self.fits.true_observed, coefficients, streams[1])

    def choices(self, drawn: Sample) -> dict[tuple[tuple[Part, ...], Sizes], np.ndarray]:
        """Numbers of the draws by the parts and the sizes of their fits."""
        if self.sizes is None:
            return chosen(self.fits, self.parts, drawn)
        return {(self.parts, self.sizes): np.arange(drawn.observed.shape[1])}

    def outcome(self, chunk: Chunk) -> Outcome:
        """All draws of a chunk, fitted and evaluated."""
        drawn = self.sample(chunk)
        before = self.fits.before(drawn.coefficients)
        after = np.empty_like(before)
        for (parts, sizes), draws in self.choices(drawn).items():
            parameters = self.fitted(parts, sizes, drawn, draws)
            after[:, draws] = self.fits.errors(parts, parameters, drawn.coefficients[:, draws])
        return Outcome(before, after)

    def fitted(self, parts: tuple[Part, ...], sizes: Sizes, drawn: Sample, draws: np.ndarray) -> Array:
        """Fitted parameters `(p, draws)`, in their units."""
        right = np.concatenate([self.fits.right(part, drawn)[:, draws] for part in parts])
        return self.fits.factorised(parts, sizes).solve(right)


def work(case: Case, chunk: Chunk) -> Outcome:
    """The outcome of one chunk of a case."""
    return prepared(case.key, case).outcome(chunk)


def prepared(key: str, case: Case) -> Prepared:
    """The case, prepared once in each process."""
    if key not in _prepared:
        while len(_prepared) >= KEPT_CASES:
            _prepared.pop(next(iter(_prepared)), None)
        _prepared[key] = Prepared.of(case)
    return _prepared[key]


KEPT_CASES = 2
_prepared: dict[str, Prepared] = {}


def _parts_and_sizes(case: Case, fits: Fits, scale: float | None) -> tuple[tuple[Part, ...], Sizes | None]:
    """The parts of the model, and their sizes where these are stated: in typical sizes, infinite without a prior."""
    if case.fit.basis != AUTO:
        parts = with_other_effects(fits.columns, stated_bases(case.fit.basis, list(fits.columns.measurement.moving)))
        return parts, fits.scaled(parts, 1.0 if scale is None else scale)
    if scale is not None and np.isinf(scale):
        raise UserError(f'basis = "{AUTO}" has as many parameters as its functions need, and needs a prior')
    parts = automatic_parts(fits.columns)
    return parts, None if scale is None else stated_sizes(fits, parts, scale)
