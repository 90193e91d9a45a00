"""The search for the bases of error motions: the same for the fit of one measurement and for all draws of a study.

The search tries all sizes of one axis after the other until no change is better. Draws with the same choice are
evaluated together.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.instruments import InstrumentBase
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import ROTARY, TARGETS, BasisChoice, repeated_targets
from kinematics.running.progress import Progress, silent
from kinematics.transforms import Array
from kinematics.user_error import UserError

AUTO = "auto"
AUTOMATIC_KINDS = InstrumentBase.BASES
"""Kinds of basis that `auto` tries for most instruments."""
ROTARY_KIND = "fourier"
"""Kind of basis for rotary axes: their errors repeat with the turn, and harmonics contain a shift of the component."""
SIZES: Mapping[str, tuple[int, ...]] = {
    "b-spline": (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48),
    "cubic": (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48),
    "legendre": (1, 2, 3, 4, 5, 6, 8, 10, 12, 16),
    "polynomial": (1, 2, 3, 4, 5, 6, 8),
    "fourier": (1, 2, 3, 4, 6, 8, 12, 16),
    TARGETS: (),
}
PRIOR_SCALES = (0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Sizes of the errors that are tried, as multiples of the typical sizes."""
SMALLER = (0.1, 0.2, 0.3, 0.5)
"""Sizes of error motions, as multiples of the typical ones, that are tried for data on a few lines."""
PRIOR, ROTARY_PRIOR = "prior", "prior of rotary axes"
FIRST_SIZE_INDEX = 1
"""Index of the size at which the search begins: coarse, because the search ends at the first local maximum."""
MOST_LINEAR_PARAMETERS = 48
"""Largest number of parameters of a linear axis."""
AT_TARGETS = 2
"""Largest number of nodes at repeated targets, as a multiple of the finest basis."""


Scales = tuple[float, float | None]
"""Sizes of the errors of linear and of rotary axes, as multiples of the typical ones; None where both are the same."""


def scale_of(scales: Scales, axis: str) -> float:
    """The size of the error motions of an axis."""
    linear, rotary = scales
    return linear if rotary is None or axis[0] not in ROTARY else rotary


@dataclass(frozen=True)
class Choice:
    """Basis of each axis, and the size of the errors as a multiple of the typical ones."""

    bases: Mapping[str, BasisChoice]
    prior_scale: float = 1.0
    rotary_scale: float | None = None
    """The same of rotary axes, where it differs."""

    @property
    def scales(self) -> Scales:
        """The sizes of the errors of linear and of rotary axes."""
        return self.prior_scale, self.rotary_scale

    def variants(self, part: str, most: Mapping[str, int]) -> list[Choice]:
        """Choices that differ in one part: a prior, or an axis with at most the number of parameters in `most`."""
        if part == PRIOR:
            return [replace(self, prior_scale=scale) for scale in PRIOR_SCALES]
        if part == ROTARY_PRIOR:
            return [replace(self, rotary_scale=scale) for scale in PRIOR_SCALES]
        kind = self.bases[part].kind
        if kind == TARGETS:
            return [self]
        sizes = [BasisChoice(kind, size) for size in SIZES[kind]]
        few = [basis for basis in sizes if basis.over((0.0, 1.0)).size <= most[part]]
        return [replace(self, bases={**self.bases, part: basis}) for basis in few or sizes[:1]]


Evidence = Callable[[Sequence[Choice], np.ndarray], Array]
"""Evidence `(choices, draws)` of choices for some of the draws, which are given by number."""
Unexplained = Callable[[Choice, np.ndarray], Array]
"""Squared residuals `(draws,)` of held-out lines under fits of a choice, up to a factor and a constant of the data.

Infinite where no line can be held out.
"""


@dataclass(frozen=True)
class Search:
    """The bases from which the search chooses."""

    kinds: Sequence[str]
    rotary_kind: str | None
    """Kind of basis for rotary axes; None for that of the linear axes."""
    prior_scale: float | None
    """None where the evidence decides."""
    most: Mapping[str, int]
    """Largest number of parameters of each axis."""
    targets: Mapping[str, int]
    """Number of targets of the axes that have a node at each target."""
    apart: bool = False
    """True where rotary axes have a size of the errors of their own.

    Spheres leave combinations of errors to their prior, such as the scale of all linear axes. With one size for all,
    the larger waves of rotary axes would explain the errors of good linear axes.
    """

    @classmethod
    def of(
        cls,
        measurement: Measurement,
        kinds: Sequence[str],
        rotary_kind: str | None,
        prior_scale: float | None,
        finest: int = MOST_LINEAR_PARAMETERS,
        finest_turn: float = np.inf,
    ) -> Search:
        """The search for a measurement: no axis gets more parameters than it has positions in the data.

        No linear axis gets more than `finest` and no rotary axis more than `finest_turn`, but an axis with at most
        AT_TARGETS times as many targets, which runs visit again and again, gets a node at each: repeats determine it
        there, and it imitates nothing that depends on direction, time or run. UserError for an unknown kind.
        """
        unknown = [kind for kind in kinds if not SIZES.get(kind)]
        if unknown:
            known = ", ".join(kind for kind, sizes in SIZES.items() if sizes)
            raise UserError(f"basis auto:{unknown[0]}: the kind is unknown; known kinds are ({known})")
        most = {axis: measurement.distinct_positions[axis] for axis in measurement.moving}
        turning = "ABC" if measurement.axis is None else ""
        few = {axis: int(min(n, finest_turn if axis[0] in turning else finest)) for axis, n in most.items()}
        targets = {axis: len(repeated_targets(measurement, axis)) for axis in most}
        targets = {axis: number for axis, number in targets.items() if 0 < number <= AT_TARGETS * finest}
        kinds_of_axes = {axis[0] in ROTARY for axis in most}
        apart = prior_scale is None and measurement.instrument.OBSERVES == "offset" and len(kinds_of_axes) == 2
        return cls(kinds, rotary_kind, prior_scale, few, targets, apart)

    @property
    def parts(self) -> list[str]:
        """The parts of a choice, in the order in which the search changes them."""
        return [*self.most, *([PRIOR] if self.prior_scale is None else []), *([ROTARY_PRIOR] if self.apart else [])]

    def start(self, kind: str) -> Choice:
        """The choice at which the search begins."""
        own = {axis: self.rotary_kind if self.rotary_kind and axis[0] in "ABC" else kind for axis in self.most}
        bases = {axis: BasisChoice(of, SIZES[of][0]) for axis, of in own.items()}
        bases |= {axis: BasisChoice(TARGETS, number) for axis, number in self.targets.items()}
        start = Choice(bases, self.prior_scale or 1.0, 1.0 if self.apart else None)
        for axis in self.most:
            start = start.variants(axis, self.most)[: FIRST_SIZE_INDEX + 1][-1]
        return start


def chosen(
    search: Search,
    draws: int,
    evidence: Evidence,
    unexplained: Unexplained | None = None,
    progress: Progress = silent,
) -> list[Choice]:
    """The choice of each draw: the one of greatest evidence, all axes in the same kind of basis.

    If `unexplained` is given (data on a few diagonals) and the size of the errors is free, smaller sizes are tried as
    well, and the choice is the one whose fits best predict the held-out lines: the evidence measures the probability of
    the data on the lines, not the errors of the model between them.
    """
    preferred = _preferred(search, np.arange(draws), evidence, progress)
    if unexplained is None or search.prior_scale is not None:
        return preferred
    best, least = list(preferred), np.full(draws, np.inf)
    for scale in (None, *SMALLER):
        tried = np.array([k for k, own in enumerate(preferred) if scale is None or scale < own.prior_scale], int)
        one = replace(search, prior_scale=scale)
        choices = _preferred(one, tried, evidence, progress) if scale else preferred
        for choice, some in grouped(choices):
            left = unexplained(choice, tried[some])
            for draw in tried[some][left < least[tried[some]]].tolist():
                best[draw] = choice
            least[tried[some]] = np.minimum(least[tried[some]], left)
    return best


def grouped(choices: Sequence[Choice]) -> list[tuple[Choice, np.ndarray]]:
    """Numbers of the draws by their choice."""
    members: dict[str, list[int]] = defaultdict(list)
    for draw, choice in enumerate(choices):
        members[repr(choice)].append(draw)
    return [(choices[draws[0]], np.array(draws)) for draws in members.values()]


def _preferred(search: Search, draws: np.ndarray, evidence: Evidence, progress: Progress) -> list[Choice]:
    """The choice of each draw with the greatest evidence."""
    found = [_climbed(search.start(kind), search, draws, evidence, progress) for kind in search.kinds]
    values = np.empty((len(found), len(draws)))
    for k, choices in enumerate(found):
        for choice, some in grouped(choices):
            values[k, some] = evidence([choice], draws[some])[0]
    return [found[kind][draw] for draw, kind in enumerate(np.argmax(values, axis=0).tolist())]


def _climbed(start: Choice, search: Search, draws: np.ndarray, evidence: Evidence, progress: Progress) -> list[Choice]:
    """The choice of each draw that no change of one part improves."""
    best, moving, turn = [start] * len(draws), np.arange(len(draws)), 0
    while len(moving):
        before, turn = list(best), turn + 1
        for tried, part in enumerate(search.parts):
            for choice, some in grouped([best[k] for k in moving]):
                names = ", ".join(f"{axis} {basis}" for axis, basis in choice.bases.items())
                progress(f"choosing the basis, pass {turn}: {names}", tried / len(search.parts))
                variants = [choice, *(each for each in choice.variants(part, search.most) if each != choice)]
                values = evidence(variants, draws[moving[some]])
                for k, number in zip(moving[some].tolist(), np.argmax(values, axis=0).tolist(), strict=True):
                    best[k] = variants[number]
        moving = np.array([k for k in moving if before[k] != best[k]], int)
    return best
