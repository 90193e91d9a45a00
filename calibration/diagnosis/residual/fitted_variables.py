"""Variables of the unexplained residual, selected again by functions of them that act in a direction of the tool.

A tracker observes along its beam and across, and the beam turns over the volume. There an error of the tool that
depends on X seems to depend on Y as well. Here the function acts in a direction of the tool, enters through the
observation equations, and keeps only the part that the model and the registration cannot imitate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from calibration.cores import each
from calibration.diagnosis.residual.dependence import EVIDENCE, LENGTHS, MOST, Unexplained
from calibration.diagnosis.residual.unnamed import COMPONENTS, Direction, may_depend_on, odds_of
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from kinematics.state import TEMPERATURE, TIME

ROWS = 400
"""Most rows that are used, evenly spread."""
KEPT = 1.0
"""Log odds that a variable found along the beam needs to stay."""
FIRST_LENGTH = 0.45
"""Length of an added variable, as a fraction of its range."""
CHANGES = 4
"""Most exchanges, additions and removals of variables."""
Lengths = dict[str, float]
"""Length by variable, as a fraction of its range."""


def fitted_variables(linearised: LinearisedFit, found: Unexplained, names: Sequence[str]) -> Lengths:
    """Variables of the unexplained residual and their lengths, from those `found` along the beam; names: all of them.

    A new variable needs log odds of `EVIDENCE`, one of `found` only `KEPT`. The result is `found` where an unnamed
    effect cannot depend on one of its variables, or where the observations have fewer than three components.
    """
    best = first = dict(zip(found.variables, found.lengths, strict=True))
    others = [name for name in names if may_depend_on(linearised, name)]
    if linearised.measurement.components < len(COMPONENTS) or not best.keys() <= set(others):
        return best
    some = linearised.thinned(ROWS)

    def odds(lengths: Lengths, component: Direction) -> float:
        tried = found._replace(variables=tuple(lengths), lengths=tuple(lengths.values()))
        return odds_of(some, component, tried) - sum(KEPT if name in first else EVIDENCE for name in lengths)

    component = COMPONENTS[int(np.argmax(each(partial(odds, best), COMPONENTS)))]
    worth_of = partial(odds, component=component)
    if _twice_time(best):
        best = _best(list(_changed(best, others)), worth_of)
    worth, best = _tuned(worth_of, best)
    for _ in range(CHANGES):
        changed = list(_changed(best, others))
        if not changed:
            break
        more, tried = _tuned(worth_of, _best(changed, worth_of))
        if more <= worth:
            break
        worth, best = more, tried
    return best


def _best(tried: Sequence[Lengths], worth: Callable[[Lengths], float]) -> Lengths:
    return tried[int(np.argmax(each(worth, tried)))]


def _changed(lengths: Lengths, names: Sequence[str]) -> Iterator[Lengths]:
    """Sets with one variable more, one less, or one exchanged, and with at most one of time and the temperatures."""
    return (changed for changed in _all_changed(lengths, names) if not _twice_time(changed))


def _twice_time(lengths: Lengths) -> bool:
    """True for more than one of time and the temperatures, which are functions of time."""
    return sum(name == TIME or name.startswith(TEMPERATURE) for name in lengths) > 1


def _all_changed(lengths: Lengths, names: Sequence[str]) -> Iterator[Lengths]:
    missing = [name for name in names if name not in lengths]
    for name in lengths:
        fewer = {each: length for each, length in lengths.items() if each != name}
        if fewer:
            yield fewer
        yield from (fewer | {other: FIRST_LENGTH} for other in missing)
    if len(lengths) < MOST:
        yield from (lengths | {other: FIRST_LENGTH} for other in missing)


def _tuned(worth: Callable[[Lengths], float], lengths: Lengths) -> tuple[float, Lengths]:
    """Largest worth of these variables over their lengths, searched one after the other; and the lengths."""
    best, found = lengths, worth(lengths)
    for name in lengths:
        tried = [{**best, name: length} for length in LENGTHS if length != best[name]]
        worths = each(worth, tried)
        if max(worths) > found:
            found, best = max(worths), tried[int(np.argmax(worths))]
    return found, best
