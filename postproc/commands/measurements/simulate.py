"""`ncomp simulate`: a virtual machine with known errors, and the observations of it by an instrument."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from postproc.commands.options.simulation import Simulation

if TYPE_CHECKING:
    from calibration.measurement.plan import Plan
    from calibration.simulation.measure_plan import VirtualInstrument
    from kinematics.machine import Machine

MeasurementFile = Annotated[
    str, typer.Option("--output", "-o", metavar="DATA.csv", help="Measurement; - for standard output.")
]
StrategyName = Annotated[
    str | None,
    typer.Option(metavar="NAME|PLAN.csv", help="A strategy, as in *ncomp plan*, or a plan of all its options."),
]

LONG = 200_000
"""Smallest number of observations for which progress is shown."""

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

    The measurement is at the positions of a strategy, or on the fly, along the path of a program that does not stop.
    """
    from calibration.simulation.effect_text import read_effects
    from calibration.simulation.measure_plan import VirtualInstrument, streams
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
    virtual_instrument = VirtualInstrument(
        simulated.instrument,
        instruments.trackers_of(tracker or []),
        simulated.stands_on,
        instruments.reach_of(elevation, incidence),
        letters,
        noise,
        simulated.faults,
        simulated.temperatures,
    )
    _simulate_plan(plan, simulated, virtual_instrument, instrument)


def _simulate_plan(plan: Plan, simulated: Simulation, virtual_instrument: VirtualInstrument, kind: str) -> None:
    """Write the observations at the positions of a plan, and the true model on request."""
    from calibration.measurement.file import write_measurement
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import console, progress_of, say

    model = simulated.model
    with progress_of(len(plan) * max(1, len(virtual_instrument.trackers)), "simulating", LONG) as progress:
        found = ncomp.simulate(plan, model, virtual_instrument, seed=simulated.seed, progress=progress)
    for note in found.notes:
        say("note", note)
    output, truth = simulated.outputs
    with whole_results(truth, output) as (truth_file, file):
        write_measurement(found.measurement, file)
        truth_file.write(encode_model(model))
    console.print(plan.summary)
    for note in found.spoiled:
        say("simulated", note)
    console.print(
        f"{len(found.measurement)} observations by {kind} of {len(model.effects)} effects, seed {simulated.seed}"
    )


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
