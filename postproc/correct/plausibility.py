"""Plausibility of a correction: its calibration, its size, its range of use, and its improvement.

An implausible correction is refused with its value, unless the user has accepted the condition by name.
"""

from __future__ import annotations

import datetime
import itertools
from collections.abc import Iterable, Mapping

import msgspec
import numpy as np

from kinematics.error_model.model import MODEL_ROUNDING, ErrorModel
from kinematics.error_model.priors import PRIORS
from kinematics.files.mistaken import did_you_mean
from kinematics.machine import Machine
from kinematics.running.durations import age_in_words
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import pose_errors
from postproc.compensation.significance import Significance
from postproc.evaluation.guard import Outside
from postproc.motion.frames import Frame
from postproc.motion.motions import Motions

REASONS: Mapping[str, str] = {
    "stale": "the calibration is older than its validity (365 days, unless it states its own)",
    "future": "the calibration is dated in the future",
    "temperature": "a temperature of this run is outside the range for which the calibration was measured",
    "outside": "more than 1 % of the evaluated moves end outside the range for which the calibration was measured",
    "insignificant": "for most moves the predicted improvement is below twice its standard uncertainty (k=2)",
    "worse": "a move is predicted to be worse than in the input",
}
"""Conditions that are refused, by their names in `--accept`."""
CLOCKS = datetime.timedelta(minutes=10)
"""Tolerance of the date of a calibration in the future, for differences of clocks."""
OUTSIDE_SHARE = 0.01
"""Share of the evaluated moves that may end outside the measured range."""
INSIGNIFICANT_SHARE = 0.5
"""Share of the moves worth correcting that may have an improvement that is not significant."""
SEARCHED_ENDLESS_MM = 1000.0
"""Length, mm, over which the largest error is searched along a linear axis without travel limits."""
TRAVEL_POSITIONS = 4096
"""Number of positions, besides the corners of the travel, for the search of the largest error."""


def parse_accepted(text: str | None, allowed: Iterable[str] = REASONS) -> frozenset[str]:
    """Names of `--accept`, separated by commas; UserError, with the list of names, for any other name."""
    names = [name.strip().lower() for name in (text or "").split(",")] if text is not None else []
    for name in names:
        if name not in allowed:
            raise UserError(
                f"--accept {text}: {name!r} is unknown{did_you_mean(name, allowed)}; expected {', '.join(allowed)}"
            )
    return frozenset(names)


class Plausibility(msgspec.Struct):
    """Refuses conditions that are not accepted, and stores accepted ones by name."""

    accepted: frozenset[str] = frozenset()
    met: dict[str, str] = msgspec.field(default_factory=dict)
    """Accepted conditions that were met: text with the value, by name."""

    def meet(self, name: str, found: str, cure: str = "") -> None:
        """Store an implausible condition; UserError unless its name is accepted. cure: another way, if there is one."""
        if name not in self.accepted:
            raise UserError(f"{found}; {cure}--accept {name} continues nevertheless")
        self.met.setdefault(name, found)

    def check_calibration(self, model: ErrorModel, conditions: Conditions, now: datetime.datetime) -> None:
        """Check the age of a calibration, and the temperatures of the run against its range."""
        age = model.age_days(now)
        made = f"calibration {model.id} is dated {model.provenance.made_at.isoformat(' ', 'minutes')}"
        day = model.provenance.measured_on
        dated = made if day is msgspec.UNSET else f"calibration {model.id} was measured on {day}"
        if age > model.valid_days:
            self.meet(
                "stale",
                f"{dated}: it is {age_in_words(age)} ({age:.0f} days), and valid for {model.valid_days:g} days",
            )
        if model.provenance.made_at - now > CLOCKS and not model.demonstration:
            self.meet("future", f"{made}, {-age:.3g} days ahead of this computer's clock")
        for sensor, (low, high) in sorted(model.temperatures.items()):
            value = conditions.temperatures.get(sensor)
            if value is not None and not low - MODEL_ROUNDING <= value <= high + MODEL_ROUNDING:
                measured = f"the calibration was measured from {low:g} to {high:g} degC"
                self.meet("temperature", f"temperature {sensor} is {value:g} degC; {measured}")

    def check_outside(self, outside: Outside) -> None:
        """Check the share of moves outside the calibrated range, once all moves are known."""
        if outside.share > OUTSIDE_SHARE:
            self.meet("outside", outside.text(), "--outside leave leaves these moves as programmed, ")

    def check_significance(self, significance: Significance) -> None:
        """Check the significance of the improvement, once all moves are known."""
        if significance.unsure > INSIGNIFICANT_SHARE * significance.worthwhile:
            self.meet("insignificant", significance.text())


class CorrectionLimit:
    """Largest plausible correction of a linear axis, um.

    It is the limit of the user, or twice the largest error of the calibration over the travel of the machine with the
    tools that the program uses, at most that of the kind of machine. Twice, because a correction relative to a datum is
    a difference of two errors. If the orientation is corrected, linear axes also compensate the rotation of rotary
    axes: the limit is that of the kind.
    """

    def __init__(
        self, machine: Machine, model: ErrorModel, conditions: Conditions, given_um: float | None, *, turns: bool
    ) -> None:
        self._machine, self._model, self._conditions, self._turns = machine, model, conditions, turns
        self._given_um, self._highest_um = given_um, machine.priors.largest_correction_um
        self._largest: dict[tuple[float, ...], float] = {}

    def um(self, frame: Frame) -> float:
        """Limit in a frame, um, for its tool and for the probe of its touch-off."""
        if self._given_um is not None:
            return self._given_um
        if self._turns:
            return self._highest_um
        tools = [frame.tool, *([] if frame.touch_off is None else [(0.0, 0.0, -frame.touch_off.length)])]
        return min(2.0 * max(map(self._largest_um, tools)), self._highest_um)

    def _largest_um(self, tool: tuple[float, ...]) -> float:
        if tool not in self._largest:
            self._largest[tool] = largest_error_um(self._machine, self._model, self._conditions, tool)
        return self._largest[tool]

    @property
    def origin(self) -> str:
        """Text on the origin of the limit."""
        if self._given_um is not None:
            return "--max-correction-um"
        if self._turns:
            return "the largest correction without --max-correction-um"
        kind = "" if self._highest_um == PRIORS.largest_correction_um else ", the limit of this kind of machine"
        most = f"at most {self._highest_um:g} um{kind}"
        return f"twice the largest error of the calibration over the machine's travel, {most}"

    @property
    def _cure(self) -> str:
        """What to check."""
        maps = [effect for effect in self._model.effects if effect.area]
        heights = [f"{each.size_summary[0]} of the map {each.note}" for each in maps]
        return f"{', '.join((*heights, 'calibration'))}, machine and set-up"

    def check(self, motions: Motions, nominal: Array, corrected: Array) -> float:
        """Largest limit of a chunk, um; Refusal at the first move with a correction beyond the limit of its frame.

        Nominal and corrected positions `(n, axes)`, mm and rad.
        """
        used = np.bincount(motions.frame, minlength=len(motions.frames)) > 0
        limits = np.array([self.um(frame) if used[i] else 0.0 for i, frame in enumerate(motions.frames)])
        columns = motions.machine.translators
        size = np.abs(corrected - nominal)[:, columns] * 1e3
        resolution = np.array([motions.machine.axes[i].resolution for i in columns]) * 1e3
        limit = limits[motions.frame]
        beyond = ~(size <= limit[:, None] + resolution)
        for row in np.flatnonzero(beyond.any(axis=1))[:1] if beyond.any() else ():
            i = int(np.argmax(size[row]))
            raise motions.blocks[motions.block[row]].refuse(
                f"{motions.machine.names[columns[i]]} would be corrected by {size[row, i]:.4g} um, more than "
                f"{limit[row]:.4g} um ({self.origin}): check {self._cure}; "
                "--max-correction-um sets another limit"
            )
        return float(limits.max(initial=0.0))


def largest_error_um(machine: Machine, model: ErrorModel, conditions: Conditions, tool: tuple[float, ...]) -> float:
    """Largest predicted error of a tool tip `(3,)`, mm, over the travel of the machine, um."""
    low, high = machine.travel
    endless = np.isinf(low) | np.isinf(high)
    low, high = (
        np.where(endless, 0.0, low),
        np.where(endless, np.where(machine.rotary, 2.0 * np.pi, SEARCHED_ENDLESS_MM), high),
    )
    axes = len(machine.axes)
    shares = np.vstack([_evenly(TRAVEL_POSITIONS, 2 * axes), _corners(axes)])
    positions = low + (high - low) * shares[:, :axes]
    approach = np.where(shares[:, axes:] < 0.5, -1.0, 1.0)
    tips = np.broadcast_to(np.array(tool, float), (len(positions), 3))
    states = conditions.states(approach)
    return float(pose_errors(machine, model, positions, positions, tips, states).point_um.max())


def _evenly(n: int, dimensions: int) -> Array:
    """Evenly distributed points `(n, dimensions)` of the unit cube, from powers of the generalised golden ratio."""
    ratio = 2.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    return np.asarray((0.5 + np.arange(1, n + 1)[:, None] * ratio ** -np.arange(1.0, dimensions + 1)) % 1.0)


def _corners(axes: int) -> Array:
    """Corners of the travel as shares, with approach in both directions `(2 ** (axes + 1), 2 * axes)`."""
    ends = np.array(list(itertools.product((0.0, 1.0), repeat=axes)))
    return np.vstack([np.hstack([ends, np.full_like(ends, direction)]) for direction in (0.0, 1.0)])
