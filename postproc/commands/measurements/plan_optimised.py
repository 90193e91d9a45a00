"""`ncomp plan optimised`: the positions that leave the least volumetric uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import ncomp
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.measurements.plan import MeasuringProgramOptions, PaceOptions, PlanFile, program_lines, write
from postproc.commands.options.declared import option
from postproc.commands.options.shared import MachineName, ResultOptions
from postproc.commands.options.strategy import POSITIONS, RotaryOptions
from postproc.commands.options.virtual_instrument import TrackerOptions

if TYPE_CHECKING:
    from calibration.measurement.plan import Choices, Plan
    from calibration.optimal.candidates import Obstacle
    from kinematics.machine import Machine

EPILOG = (
    "Examples:\n\n"
    "`ncomp plan optimised --machine gantry --minutes 120 --elevation -59:79 --incidence 60 -o plan.csv`\n\n"
    "`ncomp plan optimised --machine gantry --points 300 --tracker -1500,1500,300 --tracker 2500,-1500,300 "
    "--obstacle x=0:400,y=0:300,z=-900:-700 -o plan.csv`"
)


@dataclass(frozen=True, kw_only=True)
class OptimisedOptions(RotaryOptions, PaceOptions):
    """Positions to choose from, and their number."""

    points: int | None = option("Number of positions; or --minutes.", panel=POSITIONS)
    minutes: float | None = option("Duration of the measurement, min.", "min", min=0.01, panel=POSITIONS)
    candidates: int = option(
        "Number of positions from which the plan is selected.",
        "N",
        default=2000,
        min=100,
        max=20_000,
        panel=POSITIONS,
    )


@dataclass(frozen=True, kw_only=True)
class ViewOptions(TrackerOptions):
    """The tracker, what it observes, and what the measurement must show."""

    PANEL: ClassVar[str] = "Laser tracker"

    obstacle: tuple[str, ...] = option(
        "Box without targets that no beam may cross, mm, workpiece frame.", "x=low:high,y=...,z=..."
    )
    visible: tuple[str, ...] = option(
        "Effect of docs/effects.md that the measurement must determine to 30 % of its typical size.",
        "kind:field=value,...",
    )


def plan_optimised(
    *,
    machine: MachineName,
    output: PlanFile,
    positions: OptimisedOptions,
    view: ViewOptions,
    program: MeasuringProgramOptions,
    others: ResultOptions,
) -> None:
    """Plan the positions that leave the least volumetric uncertainty, for a number of positions or of minutes."""
    from calibration.reports.plan import plan_report

    program.refuse_without_effect()
    found = ncomp.load_machine(machine)
    choices = positions.choices(found, positions.timing())
    positions.refuse_without_effect(found)
    together = positions.target_order == "alternating"
    settings = program.settings(found, positions.feed_or_default, positions.dwell_s, together)
    dialect = program.control(found)
    made = _optimised(found, choices, positions, view)
    write(made, program_lines(made, settings, dialect), plan_report(made), program, output, others)


def _optimised(machine: Machine, choices: Choices, positions: OptimisedOptions, view: ViewOptions) -> Plan:
    """The plan; the terminal shows its predicted uncertainty."""
    from calibration.optimal.optimise import Request, optimised
    from calibration.simulation.effect_text import read_effects
    from postproc.commands.show.terminal import console

    request = Request(
        choices,
        positions.points,
        positions.minutes,
        view.trackers,
        view.reach,
        [_obstacle(text) for text in view.obstacle],
        read_effects(view.visible, machine, "--visible"),
        positions.candidates,
    )
    with console.status("optimising") as status:
        found = optimised(machine, view.instrument_of("laser-tracker"), request, status.update)
    console.print(
        f"tracker      {','.join(f'{v:g}' for v in found.tracker)} (mm, workpiece frame)\n"
        f"expected     {found.expected_um:.2f} um RMS of volumetric error, for errors of typical size"
    )
    for name, share in found.visible.items():
        console.print(f"visible      {name}: to {share:.0%} of its typical size (k = 1)")
    return found.plan


def _obstacle(text: str) -> Obstacle:
    from calibration.optimal.candidates import obstacle_of

    box: dict[str, tuple[float, float]] = {}
    for entry in text.split(","):
        letter, _, ends = entry.partition("=")
        low, high = numbers(ends, 2, f"--obstacle {text}", ":")
        if letter.strip() in box:
            raise UserError(f"--obstacle {text}: {letter.strip()} is given twice: give it once")
        box[letter.strip()] = (low, high)
    try:
        return obstacle_of(box)
    except UserError as fault:
        raise UserError(f"--obstacle {text}: {fault}") from None
