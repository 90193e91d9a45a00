"""A chunk of draws of one case: the unit of work, with the same outcome in any process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calibration.design.basis_draws import chosen, with_other_effects
from calibration.design.equations import Columns, Sample, sample
from calibration.design.held_out_lines import HeldOutLines
from calibration.design.layout import Setup
from calibration.design.solver import Fits
from calibration.fit.bases.search import AUTO, AUTOMATIC_KINDS, ROTARY_KIND, Scales, Search
from calibration.fit.linear import Part
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
    bases: tuple[Part, ...] | Search
    """The bases of all draws, or the search that chooses those of each draw."""
    scales: Scales
    """Sizes of the errors in all draws, if no search chooses them; infinite without a prior."""
    held_out_lines: HeldOutLines | None
    """Lines by which choices are evaluated, for data on a few diagonals."""

    @classmethod
    def of(cls, case: Case) -> Prepared:
        """The case with its designs."""
        setup = case.setup()
        fits = Fits(Columns(setup, case.volumes, case.other_effects), case.true_models)
        prior = case.fit.prior
        scale = None if prior == "auto" else np.inf if prior == "none" else float(prior) / TYPICAL_MOTION_UM
        scales = 1.0 if scale is None else scale, None
        return cls(case, setup, fits, _bases(case, fits, scale), scales, HeldOutLines.of(fits))

    def sample(self, chunk: Chunk) -> Sample:
        """The virtual machines of a chunk and their observations."""
        streams = [
            np.random.default_rng(np.random.SeedSequence(self.case.seed, spawn_key=(chunk.number, stream)))
            for stream in (MACHINES, NOISE)
        ]
        coefficients = self.case.true_models.draw(streams[0], chunk.draws)
        return sample(self.setup, self.fits.true_observed, coefficients, streams[1])

    def choices(self, drawn: Sample) -> dict[tuple[tuple[Part, ...], Scales], np.ndarray]:
        """Numbers of the draws by the bases and the prior of their fits."""
        if isinstance(self.bases, Search):
            return chosen(self.fits, drawn, self.bases, self.held_out_lines)
        return {(self.bases, self.scales): np.arange(drawn.observed.shape[1])}

    def outcome(self, chunk: Chunk) -> Outcome:
        """All draws of a chunk, fitted and evaluated."""
        drawn = self.sample(chunk)
        before = self.fits.before(drawn.coefficients)
        after = np.empty_like(before)
        for (parts, scales), draws in self.choices(drawn).items():
            parameters = self.fitted(parts, scales, drawn, draws)
            after[:, draws] = self.fits.errors(parts, parameters, drawn.coefficients[:, draws])
        return Outcome(before, after)

    def fitted(self, parts: tuple[Part, ...], scales: Scales, drawn: Sample, draws: np.ndarray) -> Array:
        """Fitted parameters `(p, draws)`, in their units."""
        right = np.concatenate([self.fits.right(part, drawn)[:, draws] for part in parts])
        return self.fits.factorised(parts, scales).solve(right)


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


def _bases(case: Case, fits: Fits, prior_scale: float | None) -> tuple[Part, ...] | Search:
    text, axes = case.fit.basis, list(fits.columns.measurement.moving)
    if text == AUTO or text.startswith(f"{AUTO}:"):
        if prior_scale is not None and np.isinf(prior_scale):
            raise UserError(f'basis = "{text}" is selected by the evidence, which needs a prior')
        kinds = AUTOMATIC_KINDS if text == AUTO else (text.removeprefix(f"{AUTO}:"),)
        return Search.of(fits.columns.measurement, kinds, ROTARY_KIND if text == AUTO else None, prior_scale)
    return with_other_effects(fits.columns, stated_bases(text, axes))
