"""`ncomp plan`: positions of a measurement and their order, as a table and as an NC program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

import msgspec

import ncomp
from kinematics.user_error import UserError
from postproc.commands.measurements.plan_path import STRATEGY, PathOptions, path_report, plan_of_path
from postproc.commands.measurements.plan_spheres import (
    INSTRUMENT,
    SphereOptions,
    probing_lines,
    spheres_json,
    spheres_report,
)
from postproc.commands.options.declared import REQUIRED, option, refuse_given
from postproc.commands.options.optimising import OptimisingOptions
from postproc.commands.options.path import read_path
from postproc.commands.options.program import ToolOptions
from postproc.commands.options.shared import MachineName, ResultOptions, check_files, whole_results
from postproc.commands.options.strategy import SEQUENCE, StrategyOptions, counts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.measurement.plan import Choices, Plan, Timing
    from kinematics.machine import Machine
    from postproc.generate import ProgramSettings

DWELL_S, FEED = 3.0, 2000.0
"""Default dwell at a point, s, by Montavon et al., 5.1; default feed, mm/min."""
EPILOG = (
    "Strategies: planes, hexahedron (edges), diagonals, face-diagonals, space-diagonals, grid, random, space-filling, "
    "axes (each axis alone, in both directions: ISO 230-2); on-the-fly (a path that a tracker follows).\n\n"
    "Examples:\n\n"
    "`ncomp plan --machine bzt_pfu --strategy hexahedron+random --points 170+150 -o plan.csv --nc plan.nc`\n\n"
    "`ncomp plan --machine dmu50 --strategy space-filling --rotary simultaneous --order shuffled "
    "--target t1=0,0,-120 --target t2=90,40,-180 --target-order alternating -o plan.csv`\n\n"
    "`ncomp plan --machine cframe --strategy on-the-fly --target t=0,0,-120 --length-m 21 --feed 2500 -o path.csv "
    "--nc path.nc`, or `--path mine.nc` to evaluate a program\n\n"
    "`ncomp plan --machine gantry --strategy axes --spacing 200 --runs 5 -o plan.csv --nc plan.nc --feed 3000`\n\n"
    "`ncomp plan --machine gantry --optimise --minutes 120 --elevation -59:79 --incidence 60 -o plan.csv --nc plan.nc`"
    "\n\n`ncomp plan --machine dmu50 --instrument touch-probe --points 34 --sphere s1=130,20,60 --sphere s2=-110,60,50 "
    "-o spheres.csv --nc spheres.ngc --dialect linuxcnc`"
)


@dataclass(frozen=True, kw_only=True)
class SequenceOptions(StrategyOptions):
    """Positions, their sequence, the approach to each, and the time at them."""

    strategy: str | None = option(
        "Strategy of the positions, one of those below, or several joined by +; --optimise needs none.",
        "NAME[+NAME...]",
    )
    planes_at: float = option(
        "Position of planes on the axis across them: 0 is its low end, 1 its high end.", default=1.0, panel="Positions"
    )
    rotary_points: int = option(
        "Number of positions of a rotary axis that is swept or measured alone.", default=13, panel="Positions"
    )
    approach: Literal["any", "positive", "negative"] = option(
        "Direction from which all axes approach each position.", default="any", panel=SEQUENCE
    )
    overrun: float = option(
        "Distance of the approach from one direction, mm and degrees.", "mm", default=1.0, panel=SEQUENCE
    )
    references: int = option(
        "Number of positions between measurements of a reference position, also at start and end; 0: none.",
        "N",
        default=0,
        panel=SEQUENCE,
    )
    dwell: float | None = option("Dwell at each point, s; default 3.", "s", min=0.0)
    feed: float | None = option(
        "Feed between points, mm/min; default 2000. Without --dwell and --feed the plan counts 15 s for each point.",
        "mm/min",
        min=0.1,
    )

    @property
    def dwell_s(self) -> float:
        """Dwell at each point, s."""
        return DWELL_S if self.dwell is None else self.dwell

    def timing(self) -> Timing:
        """The duration of the measurement, by dwell and feed if one of them is given."""
        from calibration.measurement.plan import Timing

        timed = self.dwell is not None or self.feed is not None
        return Timing(dwell_s=self.dwell_s, feed=self.feed or FEED) if timed else Timing()


@dataclass(frozen=True, kw_only=True)
class ProgramOptions:
    """The NC program of a plan."""

    PANEL: ClassVar[str] = "NC program"

    nc: str | None = option("File for the NC program of the measurement; `-` is standard output.", "PLAN.nc")
    dialect: Literal["iso", "linuxcnc", "fanuc", "heidenhain", "siemens"] | None = option(
        "Dialect of the program; iso is that of LinuxCNC (G53, G4 P in s), siemens is for a touch probe. Default: iso."
    )
    work_offset: str | None = option(
        "Work offset of the program, mm, so that ncomp can correct it. Default: machine coordinates, which ncomp does "
        "not correct.",
        "G54=x,y,z",
    )
    rapid: bool = option("Move in rapid, not at the feed.", default=False)

    def settings(self, machine: Machine, sequence: SequenceOptions) -> ProgramSettings:
        """Feed, dwell, stops and coordinates of the program."""
        from postproc.control.setup import parse_work_offset
        from postproc.generate import ProgramSettings

        return ProgramSettings(
            sequence.feed or FEED,
            sequence.dwell_s,
            self.rapid,
            "M1" if sequence.target_order == "alternating" else "M0",
            None if self.work_offset is None else parse_work_offset(self.work_offset, machine),
        )

    @property
    def control(self) -> str:
        """Name of the dialect in which a measuring program is written."""
        return "iso" if self.dialect in (None, "linuxcnc") else str(self.dialect)


def plan(
    *,
    machine: MachineName,
    output: str = option("File for the plan; `-` is standard output.", "PLAN.csv", "-o", default=REQUIRED),
    sequence: SequenceOptions,
    path: PathOptions,
    optimising: OptimisingOptions,
    spheres: SphereOptions,
    program: ProgramOptions,
    tools: ToolOptions,
    others: ResultOptions,
) -> None:
    """Plan a measurement: positions inside the travel, their order, the time it takes, and its NC program."""
    from calibration.measurement.plan_file import write_plan
    from calibration.on_the_fly.planning.predicted_fit import evaluated_path
    from calibration.reports.plan import plan_report
    from postproc.commands.show.terminal import show
    from postproc.generate import path_program

    inputs = check_files((path.path,), {"--output": output, "--nc": program.nc, **others.by_option})
    _check_kind(sequence, path, optimising, spheres, program)
    found = ncomp.load_machine(machine)
    choices = sequence.choices(found, sequence.timing())
    if spheres.instrument is not None:
        _of_spheres(found, choices, Given(sequence, optimising, spheres, program), output, others)
        return
    settings, dialect = program.settings(found, sequence), program.control
    if sequence.strategy == STRATEGY:
        setup = tools.set_up(found, work_offset=[program.work_offset] if program.work_offset else [])
        nominal = (
            path.planned(found, choices, settings.feed) if path.path is None else read_path(path.path, found, setup)
        )
        made = plan_of_path(nominal, choices, settings.feed)
        corners = nominal.positions / found.scale
        lines = path_program(found, corners, settings, dialect)
        shown = path_report(nominal, evaluated_path(nominal, choices.targets), settings.feed, len(choices.targets))
    else:
        if optimising.optimise:
            made = optimising.plan(found, choices, sequence.points, path.minutes)
        else:
            made = sequence.plan(found, choices)
        lines, shown = _lines(made, settings, dialect), plan_report(made)
    results = {"strategy": made.strategy, "observations": len(made), "minutes": made.minutes, "notes": made.notes}
    shown = msgspec.structs.replace(shown, head=found.report.filled(machine=found.name))
    with whole_results(program.nc, output, *others.files) as (file, table, *files):
        write_plan(made, table)
        others.write(results, shown, tuple(files), inputs)
        if program.nc is not None:
            file.writelines(f"{line}\n".encode() for line in lines)
    show(shown, "-")


class Given(NamedTuple):
    """The options of a plan of spheres."""

    sequence: SequenceOptions
    optimising: OptimisingOptions
    spheres: SphereOptions
    program: ProgramOptions


def _of_spheres(machine: Machine, choices: Choices, given: Given, output: str, others: ResultOptions) -> None:
    """Plan the centres of spheres, and write the plan, its probing program and its results."""
    from calibration.measurement.plan_file import write_plan
    from postproc.commands.show.terminal import console, say, show
    from postproc.probing.program import mask_of

    sequence, program, spheres = given.sequence, given.program, given.spheres
    count = counts(sequence.points)
    if isinstance(count, list):
        raise UserError(f"--points {sequence.points}: a touch probe takes one number of rotary positions")
    u_um, feed = given.optimising.instrument_of(INSTRUMENT).u_um, sequence.feed or FEED  # type: ignore[union-attr]
    control = "linuxcnc" if program.control == "iso" else program.control
    settings = spheres.settings(feed, program.settings(machine, sequence).offset)
    with console.status("positions within reach") as status:
        found = spheres.planned(machine, sequence.strategy, count, choices, u_um, feed, status.update)
        predicted = spheres.predicted(found)
    lines = probing_lines(found, settings, control) if program.nc is not None else iter(())
    nc = program.nc
    mask = mask_of(control, machine) if nc not in (None, "-") else None
    beside = str(Path(str(nc)).with_name("ncomp.a")) if mask else None
    report = msgspec.structs.replace(spheres_report(found, predicted), head=machine.report.filled(machine=machine.name))
    for note in found.notes:
        say("note", note)
    if nc == "-" and mask_of(control, machine):
        say("note", "the mask of FN 16, ncomp.a, is written beside a program in a file only")
    with whole_results(nc, output, beside, *others.files) as (file, rows, form, *files):
        write_plan(found.plan, rows)
        others.write(spheres_json(found, predicted), report, tuple(files), ())
        file.writelines(f"{line}\n".encode() for line in lines)
        form.write((mask or "").encode())
    show(report, "-")


def _check_kind(
    sequence: SequenceOptions,
    path: PathOptions,
    optimising: OptimisingOptions,
    spheres: SphereOptions,
    program: ProgramOptions,
) -> None:
    """UserError for options that do not apply to a plan by a strategy, optimised, on the fly or without program."""
    if spheres.instrument is not None:
        reason = f"does not apply to --instrument {INSTRUMENT}"
        refuse_given(reason, sequence, "spacing", "margin_mm", "rotary", "order", "runs", "target_order", "planes_at")
        refuse_given(reason, sequence, "rotary_points", "approach", "overrun", "dwell")
        refuse_given(reason, path, "length_m", "path", "minutes")
        refuse_given(reason, optimising, "optimise", "tracker", "elevation", "incidence", "obstacle", "visible")
        refuse_given(reason, program, "rapid")
        if program.nc is None:
            refuse_given("is an option of the NC program: give --nc too", program, "dialect", "work_offset")
        return
    reason = f"is an option of --instrument {INSTRUMENT}"
    refuse_given(reason, spheres, "sphere", "distance", "dimensions", "clearance", "probing_feed", "measuring_feed")
    if program.nc is None:
        reason = "is an option of the NC program: give --nc too"
        refuse_given(reason, program, "dialect", "rapid", *(["work_offset"] if path.path is None else []))
    if optimising.optimise:
        reason = "and --optimise exclude each other: give one of them"
        refuse_given(reason, sequence, "strategy", "spacing", "order", "approach", "runs", "references")
    else:
        own = ("tracker", "uncertainty", "elevation", "incidence", "obstacle", "visible")
        refuse_given("is an option of --optimise", optimising, *own)
    if sequence.strategy == STRATEGY:
        reason = f"does not apply to --strategy {STRATEGY}: the machine does not stop"
        refuse_given(reason, sequence, "points", "spacing", "dwell", "order", "approach", "references")
    elif sequence.strategy is None and not optimising.optimise:
        raise UserError("no positions: give --strategy NAME, or --optimise")
    else:
        reason = f"is an option of --strategy {STRATEGY}"
        refuse_given(reason, path, "length_m", "path", *([] if optimising.optimise else ["minutes"]))


def _lines(made: Plan, settings: ProgramSettings, dialect: str) -> Iterator[str]:
    """The lines of the NC program of a plan."""
    from postproc.generate import MeasuringSequence, measuring_program

    scale = made.machine.scale
    before = None if made.before is None else made.before / scale
    assert made.state.target is not None
    sequence = MeasuringSequence(
        made.machine, made.positions / scale, before, made.names.tolist(), made.state.target.tolist()
    )
    return measuring_program(sequence, settings, dialect, f"ncomp measuring plan {made.strategy}")
