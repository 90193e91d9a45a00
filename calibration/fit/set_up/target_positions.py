"""Positions of targets on the tool: unknown ones are fitted, and stated ones are compared with the data.

A constant offset of each target, in the tool's directions, is estimated beside coarse error motions of all axes and the
registration; it must be significant also beside errors of a tracker. A shift common to all targets is not visible: the
pose of the instrument and the location errors of rotary axes absorb it. Turns of all targets about the tool reference
point differ from error motions only by the priors of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from scipy import linalg, special

from calibration.fit.fit import Fit, fit
from calibration.measurement.measurement import Measurement, Target
from calibration.observation.full_model import BasisChoice, priors, rigid_model
from calibration.plausibility.finding import Finding
from kinematics.effects import AirScale, AngleHarmonic, Effect, RangeOffset, TargetOffset
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.machine import Machine, Vector
from kinematics.transforms import Array

FALSE_TARGET_PROBABILITY = 1e-6
"""Chance that one target whose position is right is found to be wrong."""
IGNORED_DIFFERENCE_UM = 1.0
"""Length, um, below which a difference is ignored: positions are stated to 1 um at best."""
TIE_CHI2 = 10.0
"""Difference of two chi2 below which the data do not show which of two targets is wrong: odds of 150 to 1."""
MOST_TARGET_NODES = 8
"""Most nodes of an error motion beside the offsets."""
MOST_COMPARED_ROWS = 3000
"""Most rows in the comparison, chosen at random."""
OFFSET_PRIOR_UM = 1e4
"""Prior standard deviation of an offset, um."""
TRACKER: tuple[Effect, ...] = (
    RangeOffset(0.0),
    AirScale(0.0),
    *(AngleHarmonic(circle, harmonic, 0.0, 0.0) for circle in ("azimuth", "elevation") for harmonic in (1, 2)),
)
"""Errors of a tracker beside which an offset must be significant too."""
WIDE_PRIOR_SIZES = 5.0
"""Prior standard deviation of these, in typical sizes."""
ONE_TARGET = (
    "one target on the tool: an error of its stated position cannot be separated from the pose of the instrument (with "
    "rotary axes: from their location errors); a second target would show it"
)
ONE_TIP = (
    "one tip: an error of its stated position cannot be separated from location errors of rotary axes in the table, "
    "nor, with one in the head, the length of the probe from the scale; a second file with a probe of another length "
    "would show it"
)


@dataclass(frozen=True)
class TargetPosition:
    """Position of a target on the tool by the data."""

    name: str
    offset: Array
    """Offset `(3,)`, mm, from the stated position, or from zero where none is stated."""
    u: Array
    """Standard uncertainties `(3,)`, mm."""
    stated: bool
    others: tuple[str, ...]
    """Other targets: one of them may be wrong by the opposite instead."""
    gain: float
    """Reduction of chi2 by this offset."""
    at_once: bool
    """True where all its rows are in sequence, so that the instrument may have moved instead."""
    runout: bool = False
    """True for the tip of a touch probe that was measured with the spindle turned by 180 degrees as well."""

    @property
    def text(self) -> str:
        """The result in one sentence, without a full stop."""
        size, u = _vector(self.offset), f"{COVERAGE_FACTOR * float(self.u.max()):.2g} mm (k=2)"
        if self.runout:
            return f"target {self.name}: runout of the tip from its stated position {size} +- {u}; the fit uses it"
        if not self.stated:
            return f"target {self.name}: its position on the tool is not stated, and fitted: {size} +- {u}"
        which = f"; or that of {' or '.join(self.others)} by the opposite: these data do not show which" * bool(
            self.others
        )
        moved = "; or the instrument moved when this target was put in" * self.at_once
        return (
            f"target {self.name}: its position on the tool differs by {size} +- {u} from the stated one{which}{moved}. "
            "The fit uses the position by the data: correct the header"
        )

    def json(self) -> dict[str, Any]:
        """The result for programs; `or`: other targets that may be wrong instead."""
        return {
            "name": self.name,
            "stated": self.stated,
            "offset_um": (1e3 * self.offset).tolist(),
            "u_um": (1e3 * self.u).tolist(),
            "or": list(self.others),
        }


def target_positions(measurement: Measurement) -> list[TargetPosition]:
    """The targets on the tool whose position is not stated, and those that are not at their stated position."""
    on_tool = _on_tool(measurement)
    unknown = [name for name in on_tool if measurement.targets[name].free]
    if len(on_tool) < 2 or measurement.instrument.components < 3:
        return []
    part = _some(_with_first_positions(measurement))
    offsets = _Offsets.of(_with_offsets(part, on_tool), len(on_tool))
    of_tracker, beside = measurement.instrument.BY_BEAM, None
    chosen = [on_tool.index(name) for name in unknown]
    others: dict[int, tuple[str, ...]] = {}
    reductions: dict[int, float] = {}
    while len(chosen) < len(on_tool) - 1:
        gains = {k: offsets.gain([*chosen, k]) - offsets.gain(chosen) for k in range(len(on_tool)) if k not in chosen}
        best = max(gains, key=lambda k: (round(gains[k], 3), k))
        if not significant(gains[best], len(on_tool)):
            break
        beside = beside or _Offsets.of(_with_offsets(part, on_tool, TRACKER if of_tracker else ()), len(on_tool))
        if not significant(beside.gain([*chosen, best]) - beside.gain(chosen), len(on_tool)):
            break
        others[best] = tuple(on_tool[k] for k, gain in gains.items() if k != best and gain > gains[best] - TIE_CHI2)
        reductions[best] = gains[best]
        chosen.append(best)
    values, u = offsets.of_targets(chosen)
    result = []
    for k, own, uncertainty in zip(chosen, values, u, strict=True):
        stated = not measurement.targets[on_tool[k]].free
        if stated and np.linalg.norm(own) < IGNORED_DIFFERENCE_UM:
            continue
        first = np.zeros(3) if stated else np.array(part.targets[on_tool[k]].position)
        at_once = stated and _in_sequence(measurement, on_tool[k])
        result.append(
            TargetPosition(
                on_tool[k],
                first + 1e-3 * own,
                1e-3 * uncertainty,
                stated,
                others.get(k, ()),
                reductions.get(k, 0.0),
                at_once,
            )
        )
    return _of_turned_spindle({name: measurement.targets[name] for name in on_tool}, result)


def _of_turned_spindle(on_tool: Mapping[str, Target], found: list[TargetPosition]) -> list[TargetPosition]:
    """The positions; of one tip with the spindle at 0 and at 180 degrees, half of the difference for each.

    A runout turns with the spindle: what both have in common belongs to the machine.
    """
    names, tips = list(on_tool), list(on_tool.values())
    if len(tips) != 2 or len(found) != 1 or abs(tips[0].spindle_deg - tips[1].spindle_deg) % 360.0 != 180.0:
        return found
    (each,) = found
    mine = replace(each, offset=each.offset / 2.0, u=each.u / 2.0, others=(), runout=True)
    other = replace(mine, name=next(name for name in names if name != each.name), offset=-mine.offset)
    return sorted([mine, other], key=lambda one: names.index(one.name))


def at_positions(measurement: Measurement, found: Sequence[TargetPosition]) -> Measurement:
    """The measurement with these targets at the positions found; the registration estimates them further."""
    changed = {}
    for each in found:
        own = measurement.targets[each.name]
        x, y, z = each.offset + (np.array(own.position) if each.stated else 0.0)
        changed[each.name] = replace(own, position=(float(x), float(y), float(z)), free=True)
    return replace(measurement, targets={**measurement.targets, **changed})


def findings(measurement: Measurement, found: Sequence[TargetPosition]) -> Iterator[Finding]:
    """Findings on the positions of targets; also where a wrong position could not be seen."""
    for each in found:
        yield Finding("targets", each.text, False)
    if len(_on_tool(measurement)) != 1:
        return
    if measurement.instrument.BY_BEAM:
        yield Finding("targets", ONE_TARGET, False)
    if measurement.instrument.FINDS_CENTRES:
        yield Finding("targets", ONE_TIP + _zero_of_table(measurement.machine), False)


def _zero_of_table(machine: Machine) -> str:
    """Clause on the zero of a rotary axis that turns all spheres as one; empty without such an axis."""
    first = machine.axes[0]
    if not first.rotary or first.side != "workpiece":
        return ""
    return (
        f"; the zero of {first.name}, which alone carries the spheres, is that of the workpiece frame, and no sphere "
        "shows it: compare it with an edge along a linear axis"
    )


def _on_tool(measurement: Measurement) -> list[str]:
    """Names of the targets on the tool that were measured."""
    names, used = list(measurement.targets), np.unique(measurement.target_number).tolist()
    return [names[k] for k in used if measurement.targets[names[k]].carrier == "tool"]


def _with_first_positions(measurement: Measurement) -> Measurement:
    """The measurement with unknown targets at first positions from the nominal machine."""
    if not any(target.free for target in measurement.targets.values()):
        return measurement
    first = measurement.first_registration[0].targets
    targets: Mapping[str, Target] = {
        name: replace(target, position=_as_vector(first[name]), free=False) if target.free else target
        for name, target in measurement.targets.items()
    }
    return replace(measurement, targets=targets)


def _as_vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


def _some(measurement: Measurement) -> Measurement:
    if len(measurement) <= MOST_COMPARED_ROWS:
        return measurement
    rows = np.random.default_rng(0).choice(len(measurement), MOST_COMPARED_ROWS, replace=False)
    return measurement.rows(np.sort(rows))


def significant(gain: float, targets: int) -> bool:
    """True where an offset of one of so many targets reduces chi2 by more than chance does."""
    return bool(special.chdtrc(3, max(gain, 0.0)) <= FALSE_TARGET_PROBABILITY / targets)


def _with_offsets(measurement: Measurement, on_tool: Sequence[str], others: Sequence[Effect] = ()) -> Fit:
    """The fit of coarse error motions, other effects, and an offset of each target; the noise from the residuals."""
    bases = {
        axis: BasisChoice("b-spline", max(2, min(MOST_TARGET_NODES, measurement.distinct_positions[axis])))
        for axis in measurement.moving
    }
    rigid = rigid_model(measurement, bases)
    wide = [WIDE_PRIOR_SIZES * quantity.typical for effect in others for quantity in effect.parameter_table]
    offsets = [TargetOffset(name, (0.0, 0.0, 0.0)) for name in on_tool]
    model = msgspec.structs.replace(rigid, effects=(*rigid.effects, *others, *offsets))
    prior = np.concatenate([priors(rigid), wide, np.full(3 * len(on_tool), OFFSET_PRIOR_UM)])
    return fit(measurement, model, prior=prior, variance="estimate")


@dataclass(frozen=True)
class _Offsets:
    """Offsets of all targets to second order, error motions and registration eliminated."""

    information: Array
    """Information `(3 k, 3 k)`, in um^-2."""
    right: Array
    """Its product with the estimate `(3 k,)`."""

    @classmethod
    def of(cls, found: Fit, count: int) -> _Offsets:
        """The offsets of a fit whose last effects are those of `count` targets."""
        whole = found.solved.information
        n = len(whole) - 3 * count
        motions = linalg.cho_factor(whole[:n, :n] + np.eye(n))
        own = whole[n:, n:] - whole[n:, :n] @ linalg.cho_solve(motions, whole[:n, n:]) + np.eye(3 * count)
        own = own / OFFSET_PRIOR_UM**2
        return cls(own, own @ found.model.parameters[n:])

    def gain(self, chosen: Sequence[int]) -> float:
        """Reduction of chi2 by the offsets of these targets."""
        some = _columns(chosen)
        if not len(some):
            return 0.0
        return float(self.right[some] @ linalg.solve(self.information[np.ix_(some, some)], self.right[some]))

    def of_targets(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Offsets `(k, 3)` of these targets where the others have none, and their standard uncertainties, um."""
        some = _columns(chosen)
        covariance = linalg.inv(self.information[np.ix_(some, some)]) if len(some) else np.zeros((0, 0))
        values = covariance @ self.right[some]
        return values.reshape(-1, 3), np.sqrt(np.diag(covariance)).reshape(-1, 3)


def _columns(chosen: Sequence[int]) -> np.ndarray:
    return np.array([3 * k + i for k in chosen for i in range(3)], int)


def _in_sequence(measurement: Measurement, name: str) -> bool:
    """True where the rows of a target follow one another."""
    rows = np.flatnonzero(measurement.target_number == list(measurement.targets).index(name))
    return bool(np.ptp(rows) == len(rows) - 1)


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in values) + ") mm"
