"""`ncomp plan optimised`: the positions that leave the least volumetric uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import ncomp
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.measurements.plan import MeasuringProgramOptions, PaceOptions, PlanFile, program_lines, write
from postproc.commands.options.declared import option
from postproc.commands.options.shared import MachineName, ResultOptions
from postproc.commands.options.strategy import POSITIONS, RotaryOptions
from postproc.commands.options.virtual_instrument import TrackerOptions

if TYPE_CHECKING:
    from calibration.measurement.plan import Choices
    from calibration.optimal.candidates import Obstacle
    from calibration.optimal.optimise import Optimised
    from kinematics.machine import Machine
    from rendering.report import Report

EPILOG = (
    "Examples:\n\n"
    "`ncomp plan optimised --machine gantry --minutes 120 --elevation -59:79 --incidence 60 -o plan.csv`\n\n"
    "`ncomp plan optimised --machine gantry --points 300 --tracker -1500,1500,300 --tracker 2500,-1500,300 "
    "--obstacle x=0:400,y=0:300,z=-900:-700 -o plan.csv`\n\n"
    "`ncomp plan optimised --machine gantry --instrument ranging --points 240 --target t1=80,0,-100 "
    "--target t2=-60,70,-150 --target t3=-60,-70,-250 -o plan.csv --nc plan.nc`"
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
    """The instrument, what it observes, and what the measurement must show."""

    PANEL: ClassVar[str] = "Instrument"

    instrument: Literal["laser-tracker", "ranging"] = option(
        "Instrument: laser-tracker, or ranging (ranges alone, from several stations).", default="laser-tracker"
    )
    stations: int | None = option(
        "Number of stations, selected among --tracker, or among places around the volume. Default: 1, for ranging 4.",
        "N",
        min=1,
    )
    targets: int | None = option("Number of targets, selected among --target. Default: all.", "N", min=1)
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
    program.refuse_without_effect()
    found = ncomp.load_machine(machine)
    choices = positions.choices(found, positions.timing())
    positions.refuse_without_effect(found)
    together = positions.target_order == "alternating"
    settings = program.settings(found, positions.feed_or_default, positions.dwell_s, together)
    dialect = program.control(found)
    made = _optimised(found, choices, positions, view)
    plan, lines = made.plan, program_lines(made.plan, settings, dialect)
    write(plan, lines, optimised_report(made), program, output, others, more=optimised_json(made))


def _optimised(machine: Machine, choices: Choices, positions: OptimisedOptions, view: ViewOptions) -> Optimised:
    """The plan and its prediction."""
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
        view.stations,
        view.targets,
    )
    with console.status("optimising") as status:
        return optimised(machine, view.instrument_of(view.instrument), request, status.update)


def optimised_json(made: Optimised) -> dict[str, Any]:
    """The set-ups and the prediction for programs."""
    return {
        "instrument": made.plan.instrument.kind() if made.plan.instrument else None,
        "stations": {name: list(place) for name, place in made.plan.stations.items()},
        "targets": {name: list(target.position) for name, target in made.plan.targets.items()},
        "expected_um": made.expected_um,
        "visible": dict(made.visible),
        "not_visible": [
            {"effects": list(each.effects), "reason": each.reason, "remedy": each.remedy} for each in made.hidden
        ],
    }


def optimised_report(made: Optimised) -> Report:
    """The plan for people, with its set-ups and its prediction."""
    import msgspec

    from calibration.reports.plan import plan_report
    from rendering.report import facts

    plan = made.plan
    assert plan.state.station is not None
    rows = [
        (
            f"station {name}",
            f"{','.join(f'{v:g}' for v in place)} (mm, workpiece frame): "
            f"{int((plan.state.station == name).sum())} observations",
        )
        for name, place in plan.stations.items()
    ]
    rows.append(("expected", f"{made.expected_um:.2f} um RMS of volumetric error, for errors of typical size"))
    rows += [("visible", f"{name}: to {share:.0%} of its typical size (k = 1)") for name, share in made.visible.items()]
    rows += [("NOT VISIBLE", str(each)) for each in made.hidden]
    report = plan_report(plan)
    return msgspec.structs.replace(report, sections=[facts("Stations and prediction", rows), *report.sections])


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
