"""`ncomp plan`: positions of a measurement and their order, as a table and as an NC program."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

import ncomp
from kinematics.user_error import UserError
from postproc.commands.measurements import plan_path
from postproc.commands.options import optimising
from postproc.commands.options import strategy as options
from postproc.commands.options.program import ToolOptions
from postproc.commands.options.shared import MachineName, whole_results

if TYPE_CHECKING:
    from calibration.measurement.plan import Choices, Plan
    from kinematics.machine import Machine
    from postproc.control.setup import Setup
    from postproc.generate import ProgramSettings

PROGRAM = "NC program"

ProgramFile = Annotated[
    str | None,
    typer.Option("--nc", metavar="PLAN.nc", rich_help_panel=PROGRAM, help="Write the program that goes there."),
]
ProgramDialect = Annotated[
    str | None,
    typer.Option(rich_help_panel=PROGRAM, help="iso (LinuxCNC: G53, G4 P in s), fanuc or heidenhain; default: iso."),
]
ProgramOffset = Annotated[
    str | None,
    typer.Option(
        metavar="G54=x,y,z",
        rich_help_panel=PROGRAM,
        help="Write positions in this work offset, so that ncomp can correct the program; "
        "default: machine coordinates, which it leaves alone.",
    ),
]
InRapid = Annotated[bool, typer.Option("--rapid", rich_help_panel=PROGRAM, help="Move in rapid, not at the feed.")]

EPILOG = (
    "Strategies: planes, hexahedron (edges), diagonals, face-diagonals, space-diagonals, grid, random, space-filling, "
    "axes (each on its own, both ways: ISO 230-2); on-the-fly (a path that a tracker follows).\n\n"
    "Examples:\n\n"
    "`ncomp plan --machine bzt_pfu --strategy hexahedron+random --points 170+150 -o plan.csv --nc plan.nc`\n\n"
    "`ncomp plan --machine dmu50 --strategy space-filling --rotary simultaneous --order shuffled "
    "--target t1=0,0,-120 --target t2=90,40,-180 --target-order alternating -o plan.csv`\n\n"
    "`ncomp plan --machine cframe --strategy on-the-fly --target t=0,0,-120 --length-m 21 --feed 2500 -o path.csv "
    "--nc path.nc`, or `--path mine.nc` to judge a program\n\n"
    "`ncomp plan --machine gantry --strategy axes --spacing 200 --runs 5 -o plan.csv --nc plan.nc --feed 3000`\n\n"
    "`ncomp plan --machine gantry --optimise --minutes 120 --elevation -59:79 --incidence 60 -o plan.csv --nc plan.nc`"
)


def plan(
    *,
    machine: MachineName,
    output: Annotated[str, typer.Option("--output", "-o", metavar="PLAN.csv", help="Plan; - for standard output.")],
    strategy: Annotated[
        str | None,
        typer.Option(metavar="NAME[+NAME...]", help="How positions are laid; see below. Or *--optimise*."),
    ] = None,
    points: options.Points = None,
    spacing: options.Spacing = None,
    ranges: options.Ranges = None,
    margin: options.Margin = 0.0,
    planes_at: options.PlanesAt = 1.0,
    rotary: options.RotaryMode = "fixed",
    rotary_points: options.RotaryPoints = 13,
    order: options.OrderName = "given",
    approach: options.ApproachName = "any",
    overrun: options.Overrun = 1.0,
    runs: options.Runs = 1,
    references: options.References = 0,
    target: options.TargetVectors = None,
    target_order: options.TargetOrderName = "in-turn",
    dwell: options.DwellTime = None,
    feed: options.Feed = None,
    length_m: plan_path.PathLength = None,
    minutes: plan_path.PathMinutes = None,
    path: plan_path.GivenPath = None,
    seed: options.Seed = 0,
    optimise: optimising.Optimise = False,
    tracker: optimising.Places = None,
    uncertainty: optimising.Uncertainties = None,
    elevation: optimising.Elevation = None,
    incidence: optimising.Incidence = None,
    obstacle: optimising.Obstacles = None,
    visible: optimising.Visible = None,
    candidates: optimising.Candidates = 2000,
    nc: ProgramFile = None,
    dialect: ProgramDialect = None,
    work_offset: ProgramOffset = None,
    tools: ToolOptions,
    rapid: InRapid = False,
) -> None:
    """Plan a measurement: positions inside the travel, their order, the time it takes, and the program for it."""
    own_offset = work_offset if path is None else None
    _check_program(nc, output, {"dialect": dialect, "work-offset": own_offset, "rapid": rapid or None})
    found = ncomp.load_machine(machine)
    choices = options.choices_of(
        found, ranges=ranges, margin=margin, rotary=rotary, order=order, runs=runs, targets=target,
        target_order=target_order, seed=seed, planes_at=planes_at, rotary_points=rotary_points, approach=approach,
        overrun=overrun, references=references, dwell=dwell, feed=feed,
    )  # fmt: skip
    settings = _program_settings(found, dwell, feed, rapid, target_order, work_offset)
    asked = optimising.Asked(tracker, uncertainty, elevation, incidence, obstacle, visible, candidates)
    asked.check(
        optimise, strategy=strategy, spacing=spacing, order=order, approach=approach, runs=runs, references=references
    )
    if strategy == plan_path.STRATEGY:
        _refuse_of_points(points, spacing, dwell, order, approach, references or None)
        length = plan_path.Length(length_m, minutes, settings.feed)
        setup = tools.set_up(found, [work_offset] if work_offset else [])
        _plan_on_the_fly(found, choices, length, path, setup, settings, dialect or "iso", (output, nc))
        return
    for option, value in (("length-m", length_m), ("minutes", None if optimise else minutes), ("path", path)):
        if value is not None:
            raise UserError(f"--{option} is of --strategy {plan_path.STRATEGY}")
    if strategy is None:
        made = optimising.optimised_plan(found, choices, points, minutes, asked)
    else:
        made = options.plan_of(found, strategy, points, spacing, choices)
    _write(made, settings, dialect or "iso", (output, nc))


def _check_program(nc: str | None, output: str, given: Mapping[str, object]) -> None:
    """UserError where program and plan have the same file, and for options of the program without --nc."""
    if nc is not None and nc == output:
        raise UserError(f"--nc and --output both name {nc}")
    for option, value in given.items():
        if nc is None and value is not None:
            raise UserError(f"--{option} is of the program: give --nc too")


def _write(made: Plan, settings: ProgramSettings, dialect: str, outputs: tuple[str, str | None]) -> None:
    """Write the plan, and its program on request."""
    from calibration.measurement.plan_file import write_plan
    from postproc.commands.show.terminal import console

    output, nc = outputs
    with whole_results(nc, output) as (program, table):
        write_plan(made, table)
        if nc is not None:
            program.writelines(f"{line}\n".encode() for line in _lines(made, settings, dialect))
    console.print(f"{made.summary}")


def _refuse_of_points(
    points: str | None, spacing: float | None, dwell: float | None, order: str, approach: str, references: int | None
) -> None:
    """UserError for options of positions: a path has none."""
    given = {"points": points, "spacing": spacing, "dwell": dwell, "references": references}
    given |= {"order": None if order == "given" else order, "approach": None if approach == "any" else approach}
    for option, value in given.items():
        if value is not None:
            raise UserError(f"--{option} is of positions: on the fly the machine does not stop")


def _plan_on_the_fly(
    machine: Machine,
    choices: Choices,
    length: plan_path.Length,
    program: str | None,
    setup: Setup,
    settings: ProgramSettings,
    dialect: str,
    outputs: tuple[str, str | None],
) -> None:
    """Plan a path, or evaluate that of a given program; write its corners as a plan, and as a program."""
    from calibration.measurement.plan_file import write_plan
    from calibration.on_the_fly.planning.predicted_fit import judged
    from postproc.commands.options.path import read_path
    from postproc.commands.show.terminal import console
    from postproc.generate import path_program

    if program is None:
        found = plan_path.planned_path(machine, choices, length)
    else:
        found = read_path(program, machine, "auto", setup)
    result_of = judged(found, choices.targets)
    made = plan_path.plan_of_path(found, choices, settings.feed)
    corners = found.positions / machine.scale
    output, nc = outputs
    with whole_results(nc, output) as (written, table):
        write_plan(made, table)
        if nc is not None:
            lines = path_program(machine, corners, settings, dialect, "ncomp path to be measured on the fly")
            written.writelines(f"{line}\n".encode() for line in lines)
    for sentence in plan_path.sentences(found, result_of, settings.feed, len(choices.targets)):
        console.print(sentence)


def _program_settings(
    machine: Machine, dwell: float | None, feed: float | None, rapid: bool, target_order: str, work_offset: str | None
) -> ProgramSettings:
    from postproc.control.setup import parse_work_offset
    from postproc.generate import ProgramSettings

    return ProgramSettings(
        feed or options.FEED,
        options.DWELL_S if dwell is None else dwell,
        rapid,
        "M1" if target_order == "alternating" else "M0",
        None if work_offset is None else parse_work_offset(work_offset, machine),
    )


def _lines(made: Plan, settings: ProgramSettings, dialect: str) -> list[str]:
    from postproc.generate import MeasuringSequence, measuring_program

    scale = made.machine.scale
    before = None if made.before is None else made.before / scale
    assert made.state.target is not None
    sequence = MeasuringSequence(
        made.machine, made.positions / scale, before, made.names.tolist(), made.state.target.tolist()
    )
    return list(measuring_program(sequence, settings, dialect, f"ncomp measuring plan {made.strategy}"))
