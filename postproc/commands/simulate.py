"""`ncomp simulate`: a virtual machine with known errors, and what an instrument would observe of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from kinematics.errors import UserError
from postproc.commands import motion
from postproc.commands import strategy as options
from postproc.commands import virtual_machine as virtual
from postproc.commands.path import read_path
from postproc.commands.program import DialectName, ToolLengths, ToolTable, WorkOffsets, setup_of
from postproc.commands.shared import MachineName, check_places, machine_of, result
from postproc.commands.virtual_instrument import (
    check_distance,
    check_names,
    instrument_of,
    standing_of,
    tracker_poses,
)

if TYPE_CHECKING:
    import numpy as np

    from calibration.instruments import Instrument, LaserTracker
    from calibration.measurement import Measurement
    from calibration.plan import Plan
    from kinematics.machine import Machine
    from kinematics.state import State
    from kinematics.transforms import Pose

INSTRUMENT, FAULTS = "The instrument", "What goes wrong"
SETUP_S = 1200.0
"""To move a tracker; virtual calibration paper, 3.2."""
LONG = 200_000
"""Observations from which progress is shown."""

EPILOG = (
    "Examples:\n\n"
    "`ncomp simulate --machine gantry --strategy hexahedron --points 600 --tracker -1500,1500,300 -o data.csv "
    "--truth truth.json`\n\n"
    "`ncomp simulate --machine bzt_pfu --strategy plan.csv --effect backlash:axis=X,width=12 "
    "--effect thermal-scale-sensor:axis=Z,sensor=scale,coefficient=11 --temperature scale=20:24 -o data.csv`\n\n"
    "`ncomp simulate --machine cframe --path path.nc --feed 2500 --feed 10000 --target t=0,0,-120 -o points.csv`\n\n"
    "`ncomp simulate --machine cframe --strategy axes --runs 5 --instrument interferometer --calibration cal.json "
    "-o data.csv`"
)


def simulate(
    machine: MachineName,
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="DATA.csv", help="Measurement; - for standard output.")
    ],
    strategy: Annotated[
        str | None,
        typer.Option(metavar="NAME|PLAN.csv", help="A strategy, as in *ncomp plan*, or a plan of all its options."),
    ] = None,
    truth: virtual.TruthFile = None,
    points: options.Points = None,
    spacing: options.Spacing = None,
    ranges: options.Ranges = None,
    margin: options.Margin = 0.0,
    rotary: options.RotaryMode = "fixed",
    order: options.OrderName = "given",
    runs: options.Runs = 1,
    target: options.TargetVectors = None,
    target_order: options.TargetOrderName = "in-turn",
    errors: virtual.Errors = None,
    calibration: virtual.TruthCalibration = None,
    location: virtual.Location = 0.0,
    effect: virtual.EffectTexts = None,
    temperature: virtual.Temperatures = None,
    instrument: Annotated[
        str, typer.Option(metavar="KIND", rich_help_panel=INSTRUMENT, help="laser-tracker, interferometer or part.")
    ] = "laser-tracker",
    uncertainty: Annotated[
        list[str] | None,
        typer.Option(
            "--uncertainty",
            "-u",
            metavar="u_angle_um=10",
            rich_help_panel=INSTRUMENT,
            help="Standard uncertainties (k=1), by their keys in a measurement file; all others are zero. Repeatable.",
        ),
    ] = None,
    tracker: Annotated[
        list[str] | None,
        typer.Option(
            metavar="x,y,z",
            rich_help_panel=INSTRUMENT,
            help="Where it stands, mm, in the workpiece frame (on the bed: machine frame). Repeatable: stations.",
        ),
    ] = None,
    stands_on: Annotated[
        str, typer.Option(metavar="workpiece|bed", rich_help_panel=INSTRUMENT, help="On the table, or on the floor.")
    ] = "workpiece",
    elevation: Annotated[
        str | None,
        typer.Option(metavar="low:high", rich_help_panel=INSTRUMENT, help="Articulation of the tracker, degrees."),
    ] = None,
    incidence: Annotated[
        float | None,
        typer.Option(
            metavar="deg", rich_help_panel=INSTRUMENT, help="Largest angle between beam and reflector's axis."
        ),
    ] = None,
    planar: Annotated[
        bool, typer.Option("--planar", rich_help_panel=INSTRUMENT, help="A part measured in x and y only.")
    ] = False,
    noise: Annotated[
        float, typer.Option(min=0.0, rich_help_panel=INSTRUMENT, help="Noise, times the uncertainties; 0 is none.")
    ] = 1.0,
    outliers: Annotated[
        float, typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="50 to 500 um off.")
    ] = 0.0,
    duplicates: Annotated[
        float,
        typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="Rows that stand there twice."),
    ] = 0.0,
    missing: Annotated[
        float, typer.Option(metavar="share", min=0.0, max=1.0, rich_help_panel=FAULTS, help="Rows that are not there.")
    ] = 0.0,
    path: motion.DrivenProgram = None,
    feed: motion.Feeds = None,
    acceleration: motion.Acceleration = 1.0,
    rate: motion.Rate = 500.0,
    vibration: motion.VibrationText = None,
    work_offset: WorkOffsets = None,
    tool_length: ToolLengths = None,
    tool_table: ToolTable = None,
    dialect: DialectName = "auto",
    seed: options.Seed = 0,
) -> None:
    """Simulate a measurement of a machine with known errors, which moves by its exact kinematics.

    At the positions of a strategy, or on the fly, along the path of a program that does not stop.
    """
    import numpy as np

    from calibration.effect_text import read_effects
    from calibration.measurement_file import write_measurement
    from calibration.simulate import Faults, observe, read_out, spoil, with_temperatures
    from kinematics.model import encode_model
    from postproc.terminal import console, progress_of, say

    if truth is not None and truth == output:
        raise UserError(f"--truth and --output both name {output}")
    check_places((strategy, calibration, path), (output, truth))
    options.check_finite(
        location=location,
        incidence=incidence,
        noise=noise,
        outliers=outliers,
        duplicates=duplicates,
        missing=missing,
    )
    found = machine_of(machine)
    # one stream each, so that another instrument measures the same machine
    draws = [np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(4)]
    told = read_effects(effect or [], found)
    model = virtual.virtual_model(found, errors, calibration, location, told, draws[0])
    sensor = instrument_of(instrument, uncertainty or [], planar)
    courses, standing = virtual.courses_of(temperature or []), standing_of(stands_on)
    if path is not None:
        given = {"strategy": strategy, "points": points, "spacing": spacing, "range": ranges, "elevation": elevation}
        motion.refuse_with_path(given | {"incidence": incidence, "duplicates": duplicates or None}, instrument)
        setup = setup_of(found, work_offset, tool_length, tool_table)
        motion.simulate_on_path(
            read_path(path, found, dialect, setup), model, told, cast("LaserTracker", sensor),
            motion.Ride(feed or [2500.0], acceleration, rate, vibration, target or [], tracker or [], standing),
            Faults(outliers, missing=missing), noise, courses, draws, (output, truth),
        )  # fmt: skip
        return
    if strategy is None:
        raise UserError("--strategy, or --path PATH.nc to measure on the fly: where is it to measure?")
    plan = _plan(found, strategy, points, spacing, ranges, margin, rotary, order, runs, target, target_order, seed)
    state, poses = _placed(plan, instrument, tracker or [], draws[1])
    check_names(told, plan.targets, [] if state.station is None else np.unique(state.station).tolist())
    state = with_temperatures(state, courses) if courses else state
    rows = _reached(plan, state, sensor, poses, standing, elevation, incidence)
    repeat = len(state) // len(plan)
    axis = None if plan.axis is None else np.tile(plan.axis, repeat)[rows]
    run = np.tile(plan.run, repeat)[rows]
    with progress_of(len(state), "simulating", LONG) as progress:
        measured = observe(
            found, model, state.rows(rows), sensor, draws[2], poses, plan.targets, stands_on=standing,
            axis=axis if instrument == "interferometer" else None, run=run, noise_scale=noise, progress=progress,
        )  # fmt: skip
    if poses is not None:
        check_distance(measured)
    measured, spoiled = spoil(read_out(measured), Faults(outliers, duplicates=duplicates, missing=missing), draws[3])
    _check_left(measured)
    with result(truth) as truth_file, result(output) as file:
        write_measurement(measured, file)
        truth_file.write(encode_model(model))
    console.print(plan.summary)
    for note in spoiled:
        say("simulated", note)
    console.print(f"{len(measured)} observations by {instrument} of {len(model.effects)} effects, seed {seed}")


def _plan(
    machine: Machine,
    strategy: str,
    points: str | None,
    spacing: float | None,
    ranges: list[str] | None,
    margin: float,
    rotary: str,
    order: str,
    runs: int,
    targets: list[str] | None,
    target_order: str,
    seed: int,
) -> Plan:
    """The plan of a file, or of a strategy."""
    from calibration.plan_file import read_plan
    from postproc.terminal import say

    if strategy == "continuous":
        raise UserError("laser runs in motion are simulated by: ncomp simulate-continuous")
    if strategy.lower().endswith(".csv") or Path(strategy).is_file():
        if not Path(strategy).exists():
            raise UserError(f"--strategy {strategy}: there is no such file")
        if any(option is not None for option in (points, spacing, ranges, targets)):
            raise UserError(f"{strategy} says already where to measure, and with which targets")
        plan = read_plan(Path(strategy), machine)
        for note in plan.notes:
            say("note", note)
        return plan
    choices = options.choices_of(
        machine,
        ranges=ranges,
        margin=margin,
        rotary=rotary,
        order=order,
        runs=runs,
        targets=targets,
        target_order=target_order,
        seed=seed,
    )
    return options.plan_of(machine, strategy, points, spacing, choices)


def _placed(
    plan: Plan, instrument: str, trackers: list[str], rng: np.random.Generator
) -> tuple[State, Mapping[str, Pose] | None]:
    """The states that are measured, once for each station, and the poses of a tracker at its stations."""
    from calibration.simulate import at_stations

    if instrument != "laser-tracker":
        if trackers:
            raise UserError(f"--tracker is no option of --instrument {instrument}")
        return plan.state, None
    poses = tracker_poses(plan.machine, plan.positions, trackers, rng)
    return at_stations(plan.state, list(poses), SETUP_S), poses


def _reached(
    plan: Plan,
    state: State,
    instrument: Instrument,
    poses: Mapping[str, Pose] | None,
    stands_on: Literal["workpiece", "bed"],
    elevation: str | None,
    incidence: float | None,
) -> np.ndarray:
    """Rows that the instrument sees; what it does not is said."""
    import numpy as np

    from calibration.measurement import Measurement
    from calibration.reach import Reach, in_reach
    from postproc.terminal import say

    if elevation is None and incidence is None:
        return np.arange(len(state))
    if poses is None:
        raise UserError("--elevation and --incidence are options of --instrument laser-tracker")
    limits = None
    if elevation is not None:
        low, high = options.numbers(elevation, 2, f"--elevation {elevation}", ":")
        limits = (low, high)
    blank = Measurement(
        plan.machine, instrument, state, np.zeros((len(state), 3)), plan.targets, stands_on=stands_on, run=None
    )
    seen = in_reach(blank, poses, Reach(limits, incidence))
    for note in seen.notes:
        say("note", note)
    if not seen.rows.any():
        raise UserError("the tracker sees none of the points from where it stands")
    return np.flatnonzero(seen.rows)


def _check_left(measured: Measurement) -> None:
    if not len(measured):
        raise UserError("--missing leaves no observation")
