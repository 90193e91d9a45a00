"""`ncomp simulate`: a virtual machine with known errors, and the observations of it by an instrument."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import ncomp
from kinematics.files.mistaken import missing
from kinematics.user_error import UserError
from postproc.commands.measurements.simulate_on_the_fly import MotionOptions, simulate_on_path
from postproc.commands.options.ballbar import BallbarOptions
from postproc.commands.options.declared import option, output_option, refuse_given
from postproc.commands.options.path import read_path
from postproc.commands.options.program import SetUpOptions
from postproc.commands.options.shared import MachineName, whole_results
from postproc.commands.options.strategy import StrategyOptions, targets_of
from postproc.commands.options.virtual_instrument import FaultOptions, InstrumentOptions
from postproc.commands.options.virtual_machine import SIMULATED, VirtualMachineOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from calibration.measurement.plan import Plan
    from calibration.simulation.measure_plan import Simulated, VirtualInstrument
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine

PROGRESS_OBSERVATIONS = 200_000
"""Smallest number of observations for which progress is shown."""

EPILOG = (
    "Examples:\n\n"
    "`ncomp simulate --machine gantry --strategy hexahedron --points 600 --tracker -1500,1500,300 -o data.csv "
    "--truth truth.json`\n\n"
    "`ncomp simulate --machine bzt_pfu --strategy plan.csv --effect backlash:axis=X,width=12 "
    "--effect thermal-scale-sensor:axis=Z,sensor=scale,coefficient=11 --temperature scale=20:24 -o data.csv`\n\n"
    "`ncomp simulate --machine cframe --path path.nc --feed 2500 --feed 10000 --target t=0,0,-120 -o points.csv`\n\n"
    "`ncomp simulate --machine cframe --strategy axes --runs 5 --instrument interferometer --calibration cal.json "
    "-o data.csv`\n\n"
    "`ncomp simulate --machine cframe --instrument ballbar --centre 300,225,250 --target t1=0,0,-120 --plane XY "
    "--feed 1000 --feed 3000 --effect backlash:axis=X,width=12 -o circles.csv`"
)


@dataclass(frozen=True, kw_only=True)
class ErrorOptions(VirtualMachineOptions):
    """Errors and temperatures of the virtual machine, with its location errors."""

    location: float = option("Largest random location error, um and urad.", "um", default=0.0, min=0.0)


class Given(NamedTuple):
    """The options that apply to a ballbar, and those that do not."""

    strategy: StrategyOptions
    instrument: InstrumentOptions
    ballbar: BallbarOptions
    motion: MotionOptions


def simulate(
    *,
    machine: MachineName,
    output: str = output_option("File for the measurement; `-` is standard output.", "DATA.csv"),
    strategy: StrategyOptions,
    errors: ErrorOptions,
    instrument: InstrumentOptions,
    faults: FaultOptions,
    ballbar: BallbarOptions,
    motion: MotionOptions,
    set_up: SetUpOptions,
) -> None:
    """Simulate a measurement of a machine with known errors, which moves by its exact kinematics.

    The measurement is at the positions of a strategy, or on the fly, along the path of a program that does not stop.
    """
    from calibration.measurement.written_file import write_measurement
    from calibration.simulation.measure_plan import streams
    from calibration.simulation.simulate import Faults
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import console, progress_of, say

    outputs = errors.truth, output
    found, seed = ncomp.load_machine(machine), strategy.seed
    # the true model, the poses, the noise, the faults: each instrument measures the same machine
    draws = streams(seed, 4)
    model = errors.model(found, seed, location=errors.location)
    of_a_plan = motion.path is None and instrument.instrument != "ballbar"
    plan = _plan(found, strategy) if of_a_plan else None
    instrument = instrument.of_plan(None if plan is None else plan.instrument)
    virtual = instrument.virtual_instrument(Faults(**vars(faults)), errors.temperatures())
    if motion.path is not None:
        motion.check(strategy, instrument, faults)
        nominal = read_path(motion.path, found, set_up.setup(found), set_up.dialect)
        simulate_on_path(nominal, motion, targets_of(strategy.target), model, virtual, draws, outputs)
        return
    if plan is None:
        summary = "circles of a ballbar"
        made = _circles(found, model, Given(strategy, instrument, ballbar, motion), virtual, draws)
    else:
        ballbar.refuse(str(instrument.instrument))
        summary = plan.summary
        with progress_of(len(plan) * max(1, len(virtual.trackers)), "simulating", PROGRESS_OBSERVATIONS) as progress:
            made = ncomp.simulate(plan, model, virtual, seed=seed, progress=progress)
    for note in made.notes:
        say("note", note)
    with whole_results(*outputs) as (truth, file):
        write_measurement(made.measurement, file, SIMULATED)
        truth.write(encode_model(model))
    console.print(summary)
    for note in made.spoiled:
        say("simulated", note)
    observations = f"{len(made.measurement)} observations by {instrument.instrument}"
    console.print(f"{observations} of {len(model.effects)} effects, seed {seed}")


def _circles(
    machine: Machine, model: ErrorModel, given: Given, virtual: VirtualInstrument, draws: Sequence[np.random.Generator]
) -> Simulated:
    """The circles of a ballbar; draws as of the command."""
    from calibration.simulation.ballbar import swept
    from calibration.simulation.measure_plan import Simulated
    from calibration.simulation.simulate import spoil

    reason = "does not apply to --instrument ballbar: its circles follow from --centre, --plane and --bar"
    refuse_given(reason, given.strategy, "strategy", "points", "spacing", "ranges")
    refuse_given(
        reason, given.instrument, "tracker", "elevation", "incidence", "beam_mm", "sphere", "distance", "planar"
    )
    target, circles = given.ballbar.target(given.strategy.target), given.ballbar.circles(given.motion.feed)
    bar = given.ballbar.instrument(virtual.instrument)
    made = swept(machine, model, bar, circles, target, (draws[1], draws[2]), virtual.noise_scale)
    made, spoiled = spoil(made, virtual.faults, draws[3])
    return Simulated(made, (), spoiled)


def _plan(machine: Machine, options: StrategyOptions) -> Plan:
    """The plan of a file, or of a strategy."""
    from calibration.measurement.plan_file import read_plan
    from postproc.commands.show.terminal import say

    strategy = options.strategy
    if strategy is None:
        raise UserError("no positions: give --strategy NAME, or --path PATH.nc for a measurement on the fly")
    if strategy == "continuous":
        raise UserError("--strategy continuous: laser runs in motion are simulated by ncomp simulate-continuous")
    if not strategy.lower().endswith(".csv") and not Path(strategy).is_file():
        return options.plan(machine, options.choices(machine))
    if not Path(strategy).exists():
        raise UserError(f"--strategy {strategy}: there is no such file{missing(strategy)}")
    reason = f"does not apply to --strategy {strategy}: the plan has its positions and targets"
    refuse_given(reason, options, "points", "spacing", "ranges", "target")
    plan = read_plan(Path(strategy), machine)
    for note in plan.notes:
        say("note", note)
    return plan
