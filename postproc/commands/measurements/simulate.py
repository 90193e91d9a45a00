"""`ncomp simulate`: a virtual machine with known errors, and what an instrument would observe of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import ncomp
from kinematics.user_error import UserError
from postproc.commands.measurements import simulate_on_the_fly as motion
from postproc.commands.options import strategy as options
from postproc.commands.options import virtual_instrument as instruments
from postproc.commands.options import virtual_machine as virtual
from postproc.commands.options.path import read_path
from postproc.commands.options.program import DialectName, SetUpOptions
from postproc.commands.options.shared import MachineName, check_apart, check_places, whole_results
from postproc.commands.options.simulation import Simulation, streams

if TYPE_CHECKING:
    import numpy as np

    from calibration.measurement.instruments import Instrument
    from calibration.measurement.plan import Plan
    from kinematics.machine import Machine
    from kinematics.state import State
    from kinematics.transforms import Pose

MeasurementFile = Annotated[
    str, typer.Option("--output", "-o", metavar="DATA.csv", help="Measurement; - for standard output.")
]
StrategyName = Annotated[
    str | None,
    typer.Option(metavar="NAME|PLAN.csv", help="A strategy, as in *ncomp plan*, or a plan of all its options."),
]

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
    *,
    machine: MachineName,
    output: MeasurementFile,
    strategy: StrategyName = None,
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
    instrument: instruments.InstrumentKind = "laser-tracker",
    error_motions: instruments.ErrorMotions = None,
    uncertainty: instruments.Uncertainties = None,
    tracker: instruments.TrackerPlaces = None,
    stands_on: instruments.StandsOn = "workpiece",
    elevation: instruments.Elevation = None,
    incidence: instruments.Incidence = None,
    planar: instruments.Planar = False,
    noise: instruments.NoiseScale = 1.0,
    outliers: instruments.Outliers = 0.0,
    duplicates: instruments.Duplicates = 0.0,
    missing: instruments.Missing = 0.0,
    path: motion.DrivenProgram = None,
    feed: motion.Feeds = None,
    acceleration: motion.Acceleration = 1.0,
    rate: motion.Rate = 500.0,
    vibration: motion.VibrationText = None,
    set_up: SetUpOptions,
    dialect: DialectName = "auto",
    seed: options.Seed = 0,
) -> None:
    """Simulate a measurement of a machine with known errors, which moves by its exact kinematics.

    At the positions of a strategy, or on the fly, along the path of a program that does not stop.
    """
    from calibration.simulation.effect_text import read_effects
    from calibration.simulation.simulate import Faults

    check_apart({"--truth": truth, "--output": output})
    check_places((strategy, calibration, path), (output, truth))
    options.check_finite(
        location=location, incidence=incidence, noise=noise, outliers=outliers, duplicates=duplicates, missing=missing
    )
    found, draws = ncomp.load_machine(machine), streams(seed, 4)
    told = read_effects(effect or [], found)
    simulated = Simulation(
        virtual.virtual_model(found, errors, calibration, location, told, draws[0]), told,
        instruments.instrument_of(instrument, uncertainty or [], planar), instruments.standing_of(stands_on), noise,
        Faults(outliers, duplicates=duplicates, missing=missing), virtual.courses_of(temperature or []), seed, draws,
        (output, truth),
    )  # fmt: skip
    if path is not None:
        given = {"strategy": strategy, "points": points, "spacing": spacing, "range": ranges, "elevation": elevation}
        motion.refuse_with_path(given | {"incidence": incidence, "duplicates": duplicates or None}, instrument)
        nominal = read_path(path, found, dialect, set_up.setup(found))
        ride = motion.Ride(feed or [2500.0], acceleration, rate, vibration, target or [], tracker or [])
        motion.simulate_on_path(nominal, ride, simulated)
        return
    plan = _plan(found, strategy, points, spacing, ranges, margin, rotary, order, runs, target, target_order, seed)
    letters = instruments.error_motions_of(error_motions, instrument)
    _simulate_plan(plan, simulated, instrument, tracker or [], elevation, incidence, letters)


def _simulate_plan(
    plan: Plan,
    simulated: Simulation,
    kind: str,
    trackers: list[str],
    elevation: str | None,
    incidence: float | None,
    letters: tuple[str, ...],
) -> None:
    """Write what is observed at the positions of a plan, and the truth where it is asked for.

    kind: of the instrument, as in `--instrument`; letters: of the error motions that an interferometer observes.
    """
    import numpy as np

    from calibration.measurement.file import write_measurement
    from calibration.simulation.simulate import observe, read_out, spoil, with_temperatures
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import console, progress_of, say

    model, draws, standing = simulated.model, simulated.draws, simulated.stands_on
    state, poses = _placed(plan, kind, trackers, draws[1])
    instruments.check_names(
        simulated.told, plan.targets, [] if state.station is None else np.unique(state.station).tolist()
    )
    state = with_temperatures(state, simulated.temperatures) if simulated.temperatures else state
    rows = _reached(plan, state, simulated.instrument, poses, standing, elevation, incidence)
    repeat = len(state) // len(plan)
    axis = None if plan.axis is None else np.tile(plan.axis, repeat)[rows]
    component = None
    if letters and axis is not None:
        rows, component = _components(plan.machine, axis, rows, letters)
        axis = np.tile(np.asarray(plan.axis), repeat)[rows]
    run = np.tile(plan.run, repeat)[rows]
    with progress_of(len(state), "simulating", LONG) as progress:
        measured = observe(
            plan.machine, model, state.rows(rows), simulated.instrument, draws[2], poses, plan.targets,
            stands_on=standing, axis=axis if kind == "interferometer" else None, run=run, component=component,
            noise_scale=simulated.noise_scale, progress=progress,
        )  # fmt: skip
    if poses is not None:
        instruments.check_distance(measured)
    measured, spoiled = spoil(read_out(measured), simulated.faults, draws[3])
    if not len(measured):
        raise UserError("--missing leaves no observation")
    output, truth = simulated.outputs
    with whole_results(truth, output) as (truth_file, file):
        write_measurement(measured, file)
        truth_file.write(encode_model(model))
    console.print(plan.summary)
    for note in spoiled:
        say("simulated", note)
    console.print(f"{len(measured)} observations by {kind} of {len(model.effects)} effects, seed {simulated.seed}")


def _components(
    machine: Machine, axis: np.ndarray, rows: np.ndarray, letters: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Rows `(m,)` of the plan, those of linear axes once for each error motion, and the error motions `(m,)`."""
    import numpy as np

    linear = ~machine.rotary[[machine.index(name) for name in axis.tolist()]]
    every = np.repeat(rows, np.where(linear, len(letters), 1))
    component = np.concatenate([list(letters) if own else [""] for own in linear.tolist()])
    return every, component


def _plan(
    machine: Machine,
    strategy: str | None,
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
    from calibration.measurement.plan_file import read_plan
    from postproc.commands.show.terminal import say

    if strategy is None:
        raise UserError("--strategy, or --path PATH.nc to measure on the fly: where is it to measure?")
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
    from calibration.simulation.simulate import at_stations

    if instrument != "laser-tracker":
        if trackers:
            raise UserError(f"--tracker is no option of --instrument {instrument}")
        return plan.state, None
    poses = instruments.tracker_poses(plan.machine, plan.positions, trackers, rng)
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

    from calibration.measurement.measurement import Measurement
    from calibration.observation.reach import Reach, in_reach
    from postproc.commands.show.terminal import say

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
