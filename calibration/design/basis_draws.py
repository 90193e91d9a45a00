"""The basis of every draw, chosen as `ncomp fit` does, for a whole chunk of draws at once.

Draws with the same choice are evaluated together: each choice is factorised once for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.design.equations import OTHER_EFFECTS, Columns, Sample
from calibration.design.held_out_lines import HeldOutLines
from calibration.design.solver import Fits
from calibration.fit.bases import search as basis_search
from calibration.fit.bases.search import Choice, Evidence, Scales, Search, Unexplained
from calibration.fit.linear import Part
from calibration.observation.full_model import BasisChoice
from kinematics.transforms import Array


def chosen(
    fits: Fits, drawn: Sample, search: Search, held_out_lines: HeldOutLines | None = None
) -> dict[tuple[tuple[Part, ...], Scales], np.ndarray]:
    """Numbers of the draws by the parts and the sizes of the errors of their fits."""
    number = drawn.observed.shape[1]
    unexplained = None if held_out_lines is None else _unexplained(held_out_lines, drawn)
    best = basis_search.chosen(search, number, _evidence(fits, drawn), unexplained)
    return {(parts_of(fits, choice), choice.scales): draws for choice, draws in basis_search.grouped(best)}


def _evidence(fits: Fits, drawn: Sample) -> Evidence:
    right: dict[Part, Array] = {}

    def of_one(choice: Choice, draws: np.ndarray) -> Array:
        """Logarithm of the evidence of one choice of bases, for each of these draws."""
        parts = parts_of(fits, choice)
        for part in parts:
            if part not in right:
                right[part] = fits.right(part, drawn)
        sums = np.concatenate([right[part][:, draws] for part in parts])
        made = fits.factorised(parts, choice.scales)
        return np.asarray(0.5 * (np.sum(sums * made.solve(sums), axis=0) - made.log_determinant))

    def evidence(choices: Sequence[Choice], draws: np.ndarray) -> Array:
        return np.stack([of_one(choice, draws) for choice in choices])

    return evidence


def _unexplained(held_out_lines: HeldOutLines, drawn: Sample) -> Unexplained:
    def left(choice: Choice, draws: np.ndarray) -> Array:
        parts = parts_of(held_out_lines.fits, choice)
        return held_out_lines.left(parts, choice.scales, drawn.observed[:, draws])

    return left


def parts_of(fits: Fits, choice: Choice) -> tuple[Part, ...]:
    """The parts of the model of a choice."""
    return with_other_effects(fits.columns, choice.bases)


def with_other_effects(columns: Columns, bases: Mapping[str, BasisChoice]) -> tuple[Part, ...]:
    """The parts of a model with these bases, and of its additional effects."""
    other_effects = ((OTHER_EFFECTS, ""),) if columns.other_effects else ()
    return (*((axis, str(basis)) for axis, basis in bases.items()), *other_effects)
