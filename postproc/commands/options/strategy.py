"""The options of strategies, which `plan` and `simulate` share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import ncomp
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Target
    from calibration.measurement.plan import Choices, Plan
    from kinematics.machine import Machine

DWELL_S, FEED = 3.0, 2000.0
"""Default dwell at a point, s, by Montavon et al., 5.1; default feed, mm/min."""
WHERE, ORDER, TARGETS = "Where", "In which order", "Targets"

Points = Annotated[
    str | None,
    typer.Option(
        metavar="N[+N...]",
        rich_help_panel=WHERE,
        help="Number of positions, of each strategy joined by +; default 600. "
        "Order, runs, targets and references come on top.",
    ),
]
Spacing = Annotated[float | None, typer.Option(metavar="mm", rich_help_panel=WHERE, help="Or the largest spacing.")]
Ranges = Annotated[
    list[str] | None,
    typer.Option(
        "--range",
        metavar="X=low:high",
        rich_help_panel=WHERE,
        help="Part of an axis' travel, mm or degrees; Z=300 fixes it. Repeatable.",
    ),
]
Margin = Annotated[
    float, typer.Option(metavar="mm", rich_help_panel=WHERE, help="Kept from the travel ends of linear axes.")
]
PlanesAt = Annotated[
    float, typer.Option(rich_help_panel=WHERE, help="Where planes lie on the axis across: 0 low end ... 1 high end.")
]
RotaryMode = Annotated[
    str,
    typer.Option(
        "--rotary",
        metavar="MODE",
        rich_help_panel=WHERE,
        help="Rotary axes: fixed (at home), swept (one by one, afterwards), random, simultaneous (all axes at once).",
    ),
]
RotaryPoints = Annotated[
    int, typer.Option(rich_help_panel=WHERE, help="Positions of a rotary axis that is swept or measured on its own.")
]
OrderName = Annotated[
    str,
    typer.Option(
        "--order",
        metavar="given|shuffled|retraced",
        rich_help_panel=ORDER,
        help="Shuffled tells drift from geometry; retraced: there and back.",
    ),
]
ApproachName = Annotated[
    str,
    typer.Option(
        "--approach",
        metavar="any|positive|negative",
        rich_help_panel=ORDER,
        help="Come to every position from one side, on all axes.",
    ),
]
Overrun = Annotated[
    float, typer.Option(metavar="mm", rich_help_panel=ORDER, help="How far from that side, mm and degrees.")
]
Runs = Annotated[int, typer.Option(rich_help_panel=ORDER, help="How often everything is repeated.")]
References = Annotated[
    int,
    typer.Option(
        metavar="N", rich_help_panel=ORDER, help="Measure a reference position first, after every N others, and last."
    ),
]
TargetVectors = Annotated[
    list[str] | None,
    typer.Option(
        "--target",
        metavar="t1=x,y,z",
        rich_help_panel=TARGETS,
        help="Reflector, mm from the spindle nose; table.p1=x,y,z and bed.r1=x,y,z sit there. Repeatable.",
    ),
]
TargetOrderName = Annotated[
    str,
    typer.Option(
        "--target-order",
        metavar="in-turn|alternating",
        rich_help_panel=TARGETS,
        help="Everything with one target and then the next, or all of them at each position.",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Of everything that is random: the same seed, the same file.")]
DwellTime = Annotated[
    float | None,
    typer.Option("--dwell", metavar="s", min=0.0, help="At each point; with --feed, for the time. Default 3."),
]
Feed = Annotated[
    float | None,
    typer.Option(
        metavar="mm/min", min=0.1, help="Between points, default 2000; without --dwell and --feed, 15 s per point."
    ),
]


def choices_of(
    machine: Machine,
    *,
    ranges: list[str] | None,
    margin: float,
    rotary: str,
    order: str,
    runs: int,
    targets: list[str] | None,
    target_order: str,
    seed: int,
    planes_at: float = 1.0,
    rotary_points: int = 13,
    approach: str = "any",
    overrun: float = 1.0,
    references: int = 0,
    dwell: float | None = None,
    feed: float | None = None,
) -> Choices:
    """Choices from the options; the planning itself refuses unknown names."""
    from calibration.measurement.measurement import SPINDLE_NOSE
    from calibration.measurement.plan import Choices, Timing

    check_finite(dwell=dwell, feed=feed)
    timed = dwell is not None or feed is not None
    return Choices(
        ranges=dict(_range(text, machine) for text in ranges or ()),
        margin_mm=margin,
        planes_at=planes_at,
        rotary=rotary,  # type: ignore[arg-type]
        rotary_points=rotary_points,
        order=order,  # type: ignore[arg-type]
        approach=approach,  # type: ignore[arg-type]
        overrun=overrun,
        runs=runs,
        references=references,
        targets=targets_of(targets) if targets else {"1": SPINDLE_NOSE},
        target_order=target_order,  # type: ignore[arg-type]
        timing=Timing(dwell_s=DWELL_S if dwell is None else dwell, feed=feed or FEED) if timed else Timing(),
        seed=seed,
    )


def plan_of(machine: Machine, strategy: str, points: str | None, spacing: float | None, choices: Choices) -> Plan:
    """The plan of a strategy; shows its notes."""
    from postproc.commands.show.terminal import say

    if strategy.lower().endswith(".csv"):
        there = "a plan already, for ncomp simulate" if Path(strategy).exists() else "there is no such file"
        raise UserError(f"--strategy {strategy}: {there}")
    made = ncomp.plan(machine, strategy, counts(points), spacing, choices)
    for note in made.notes:
        say("note", note)
    return made


def check_finite(**options: float | None) -> None:
    """UserError for the first option whose number is not finite (nan, inf)."""
    for name, value in options.items():
        if value is not None and not math.isfinite(value):
            raise UserError(f"--{name.replace('_', '-')} {value}: no number")


def numbers(text: str, count: int, where: str, separator: str = ",") -> tuple[float, ...]:
    """`count` finite numbers in a text; UserError, with the option's name in `where`, for any other text."""
    try:
        values = tuple(float(entry) for entry in text.split(separator))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise UserError(f"{where}: {text!r} is not {count} numbers with {separator!r} between them")
    return values


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
        place, equals, vector = text.partition("=")
        key, dot, name = place.strip().partition(".")
        if not dot:
            key, name = "target", place.strip()
        if key not in CARRIERS or not equals or not name or name in found:
            raise UserError(f"--target {text}: expected t1=x,y,z, table.p1=x,y,z or bed.r1=x,y,z, each name once")
        x, y, z = numbers(vector, 3, f"--target {text}")
        found[name] = Target((x, y, z), CARRIERS[key])
    return found


def counts(text: str | None) -> int | list[int] | None:
    """Numbers of positions, one for each strategy; a plain number where there is one only."""
    if text is None:
        return None
    try:
        counts = [int(entry) for entry in text.split("+")]
    except ValueError:
        raise UserError(f"--points {text}: expected a number, or one for each strategy, e.g. 170+150") from None
    return counts if len(counts) > 1 else counts[0]
