"""The options of strategies, which `plan` and `simulate` share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import ncomp
from kinematics.files.mistaken import missing
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.options.declared import option, refuse_given
from postproc.commands.options.files import file_if_there
from postproc.commands.options.shared import Seed

if TYPE_CHECKING:
    from calibration.measurement.measurement import Target
    from calibration.measurement.plan import Choices, Plan, Timing
    from kinematics.machine import Machine

POSITIONS, SEQUENCE, TARGETS = "Positions", "Sequence", "Targets"
Margin = Annotated[
    float,
    option("Distance from the travel ends of linear axes, mm.", "mm", "--margin", default=0.0, panel=POSITIONS),
]


@dataclass(frozen=True, kw_only=True)
class VolumeOptions:
    """Volume of the positions, and the targets; names are those of the library's `Choices`."""

    ranges: tuple[str, ...] = option(
        "Range of an axis within its travel, mm or degrees: X=100:900; Z=300 fixes the axis. Default: the travel.",
        "X=low:high",
        "--range",
        panel=POSITIONS,
    )
    target: tuple[str, ...] = option(
        "Position of a reflector, mm from the spindle nose; on the table table.p1=x,y,z, on the bed bed.r1=x,y,z.",
        "t1=x,y,z",
        panel=TARGETS,
    )
    seed: Seed

    def choices(self, machine: Machine, timing: Timing | None = None) -> Choices:
        """The choices for the positions and their sequence; UserError for a range or target that cannot be used."""
        from calibration.measurement.measurement import SPINDLE_NOSE
        from calibration.measurement.plan import Choices, Timing

        names = {field.name for field in fields(Choices)}
        same = {name: value for name, value in vars(self).items() if name in names}
        parsed = {
            "ranges": dict(_range(text, machine) for text in self.ranges),
            "targets": targets_of(self.target) or {"1": SPINDLE_NOSE},
            "timing": timing or Timing(),
        }
        return Choices(**same | parsed)


@dataclass(frozen=True, kw_only=True)
class RotaryOptions(VolumeOptions):
    """Positions within the travel, with the rotary axes."""

    margin_mm: Margin
    rotary: Literal["fixed", "swept", "random", "simultaneous"] = option(
        "Rotary axes: fixed at home, swept one by one afterwards, random, or moved together with the linear axes.",
        default="fixed",
        panel=POSITIONS,
    )
    target_order: Literal["in-turn", "alternating"] = option(
        "Order of the targets: the whole sequence with each target in turn, or all targets at each position.",
        default="in-turn",
        panel=TARGETS,
    )

    def refuse_without_effect(self, machine: Machine) -> None:
        """UserError for an option that this machine does not use."""
        if not machine.rotary.any():
            refuse_given(f"has no effect: machine {machine.name} has no rotary axis", self, "rotary")
        if len(self.target) < 2:
            refuse_given("has no effect on one target: give another --target, or leave it out", self, "target_order")


@dataclass(frozen=True, kw_only=True)
class StrategyOptions(RotaryOptions):
    """Positions of a strategy, and their sequence."""

    strategy: str | None = option(
        "Strategy of the positions, as for ncomp plan points, or file of a plan.",
        "NAME|PLAN.csv",
        reads=file_if_there,
        panel=POSITIONS,
    )
    points: str | None = option(
        "Number of positions, for each strategy joined by +: 170+150; default 600. Order, runs, targets and references "
        "add observations.",
        "N[+N...]",
        panel=POSITIONS,
    )
    spacing: float | None = option(
        "Largest distance of neighbouring positions, mm, instead of --points.", "mm", panel=POSITIONS
    )
    order: Literal["given", "shuffled", "retraced"] = option(
        "Order of the positions: shuffled separates drift from geometry; retraced is there and back.",
        default="given",
        panel=SEQUENCE,
    )
    runs: int = option("Number of repetitions of the whole sequence.", default=1, panel=SEQUENCE)

    @property
    def parts(self) -> set[str]:
        """Names of the strategies that are joined."""
        return {part.strip() for part in str(self.strategy).split("+")}

    def refuse_without_effect(self, machine: Machine) -> None:
        """UserError for an option that this strategy, or this machine, does not use."""
        from calibration.planning.patterns import SCATTERED

        if self.parts <= set(SCATTERED):
            refuse_given(f"has no effect on --strategy {self.strategy}: give --points", self, "spacing")
        super().refuse_without_effect(machine)

    def plan(self, machine: Machine, choices: Choices) -> Plan:
        """The plan of the strategy; shows its notes."""
        from postproc.commands.show.terminal import say

        strategy = str(self.strategy)
        if strategy.lower().endswith(".csv"):
            none = f"there is no such file{missing(strategy)}"
            reason = "a plan is an input of ncomp simulate" if Path(strategy).exists() else none
            raise UserError(f"--strategy {strategy}: {reason}")
        self.refuse_without_effect(machine)
        made = ncomp.plan(machine, strategy, _counts(self.points), self.spacing, choices)
        for note in made.notes:
            say("note", note)
        return made


def _range(text: str, machine: Machine) -> tuple[str, tuple[float, float]]:
    name, _, ends = text.partition("=")
    name = name.strip().upper()
    machine.index(name)
    values = numbers(ends, 1 + (":" in ends), f"--range {text}", ":")
    return name, (values[0], values[-1])


def targets_of(texts: Sequence[str]) -> dict[str, Target]:
    """Reflectors by name, from `t1=x,y,z`, `table.p1=x,y,z` or `bed.r1=x,y,z`."""
    from calibration.measurement.measurement import Target
    from calibration.measurement.states import CARRIERS

    found: dict[str, Target] = {}
    for text in texts:
        carried, equals, vector = text.partition("=")
        key, dot, name = carried.strip().partition(".")
        if not dot:
            key, name = "target", carried.strip()
        if key not in CARRIERS or not equals or not name or name in found:
            raise UserError(f"--target {text}: expected t1=x,y,z, table.p1=x,y,z or bed.r1=x,y,z, each name once")
        x, y, z = numbers(vector, 3, f"--target {text}")
        found[name] = Target((x, y, z), CARRIERS[key])
    return found


def _counts(text: str | None) -> int | list[int] | None:
    """Numbers of positions, one for each strategy; a single number for one strategy."""
    if text is None:
        return None
    try:
        counts = [int(entry) for entry in text.split("+")]
    except ValueError:
        whole = "expected a whole number without separators, or one for each strategy, e.g. 170+150"
        raise UserError(f"--points {text}: {whole}") from None
    return counts if len(counts) > 1 else counts[0]
