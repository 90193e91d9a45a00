"""`ncomp simulate-continuous`: a virtual laser that follows an axis in motion, and its quasi-static measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options import strategy as options
from postproc.commands.options import virtual_machine as virtual
from postproc.commands.options.shared import MachineName, check_apart, check_places, whole_results

if TYPE_CHECKING:
    from kinematics.effects import Effect
    from kinematics.machine import Machine

MOTION, LASER, TARGETS = "The motion", "The laser", "The quasi-static measurement"

RunsFile = Annotated[
    str, typer.Option("--output", "-o", metavar="CONTINUOUS.csv", help="Continuous runs; - for standard output.")
]
Acceleration = Annotated[float, typer.Option(metavar="m/s2", min=1e-3, rich_help_panel=MOTION, help="Of the axis.")]
Lag = Annotated[
    float, typer.Option(metavar="ms", min=0.0, rich_help_panel=MOTION, help="Time constant of the position loop.")
]
Vibrations = Annotated[
    list[str] | None,
    typer.Option(metavar="Hz:um", rich_help_panel=LASER, help="Of the machine, all the time. Repeatable."),
]
Settling = Annotated[
    str | None,
    typer.Option(metavar="Hz:um:s", rich_help_panel=LASER, help="Vibration that dies away after each ramp."),
]
Dropped = Annotated[
    float, typer.Option(metavar="share", min=0.0, max=0.9, rich_help_panel=LASER, help="Samples that are lost.")
]
Uncertainty = Annotated[
    float, typer.Option("--u-um", metavar="um", min=1e-6, rich_help_panel=TARGETS, help="Of a reading (k=1).")
]
EndEffect = Annotated[
    str | None,
    typer.Option(metavar="um:mm", rich_help_panel=virtual.PANEL, help="At both ends, and how far it reaches."),
]

EPILOG = (
    "Examples:\n\n"
    "`ncomp simulate-continuous --machine cframe --axis X --start-mm 0 --end-mm 450 --feed 500 --spacing 90 "
    "-o run.csv --quasistatic targets.csv --truth truth.json`\n\n"
    "`ncomp simulate-continuous --machine gantry --axis X --start-mm 0 --end-mm 2450 --feed 5000 --rate 1000 "
    "--spacing 175 --passes 3 --both --runs 5 --vibration 35:0.3 --settling 18:20:0.2 "
    "--effect backlash:axis=X,width=12 -o run.csv --quasistatic targets.csv`\n\n"
    "then `ncomp continuous run.csv targets.csv -o table.csv`"
)


def simulate_continuous(
    machine: MachineName,
    axis: Annotated[str, typer.Option(metavar="X", help="The linear axis.")],
    start_mm: Annotated[float, typer.Option("--start-mm", metavar="mm", help="Where the run begins.")],
    end_mm: Annotated[float, typer.Option("--end-mm", metavar="mm", help="Where it ends.")],
    output: RunsFile,
    quasistatic: Annotated[str, typer.Option(metavar="QUASISTATIC.csv", help="Readings at targets.")],
    truth: virtual.TruthFile = None,
    feed: Annotated[float, typer.Option(metavar="mm/min", min=0.1, rich_help_panel=MOTION, help="Programmed.")] = 500.0,
    acceleration: Acceleration = 1.0,
    jerk: Annotated[float, typer.Option(metavar="m/s3", min=1e-2, rich_help_panel=MOTION, help="Of the axis.")] = 50.0,
    lag: Lag = 20.0,
    passes: Annotated[int, typer.Option(min=1, rich_help_panel=MOTION, help="How often the run is repeated.")] = 1,
    both: Annotated[bool, typer.Option("--both", rich_help_panel=MOTION, help="There and back each time.")] = False,
    rate: Annotated[float, typer.Option(metavar="Hz", min=1.0, rich_help_panel=LASER, help="Sampling.")] = 100.0,
    noise: Annotated[float, typer.Option(metavar="um", min=0.0, rich_help_panel=LASER, help="Of a sample.")] = 0.1,
    vibration: Vibrations = None,
    settling: Settling = None,
    jitter: Annotated[float, typer.Option(metavar="us", min=0.0, rich_help_panel=LASER, help="Of time stamps.")] = 0.0,
    dropped: Dropped = 0.0,
    spacing: Annotated[float, typer.Option(metavar="mm", rich_help_panel=TARGETS, help="Between targets.")] = 100.0,
    runs: Annotated[int, typer.Option(min=1, rich_help_panel=TARGETS, help="Cycles, there and back.")] = 1,
    dwell: Annotated[float, typer.Option(metavar="s", min=0.0, rich_help_panel=TARGETS, help="At each target.")] = 4.0,
    u_um: Uncertainty = 0.2,
    errors: virtual.Errors = None,
    calibration: virtual.TruthCalibration = None,
    effect: virtual.EffectTexts = None,
    end_effect: EndEffect = None,
    temperature: virtual.Temperatures = None,
    seed: options.Seed = 0,
) -> None:
    """Simulate laser runs of one axis at constant velocity, and a quasi-static measurement before them."""
    from calibration.continuous.record_file import write_records
    from calibration.continuous.virtual import Laser, Motion, Targets, measure
    from calibration.measurement.file import write_measurement
    from calibration.measurement.instruments import Interferometer
    from calibration.simulation.effect_text import read_effects
    from calibration.simulation.measure_plan import streams
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import console

    places = {"--output": output, "--quasistatic": quasistatic, "--truth": truth}
    check_places((calibration,), places.values())
    check_apart(places)
    options.check_finite(
        start_mm=start_mm, end_mm=end_mm, feed=feed, acceleration=acceleration, jerk=jerk, lag=lag, rate=rate,
        noise=noise, jitter=jitter, dropped=dropped, spacing=spacing, dwell=dwell, u_um=u_um,
    )  # fmt: skip
    found = ncomp.load_machine(machine)
    axis = axis.strip().upper()
    _check_way(found, axis, start_mm, end_mm, spacing)
    draws = streams(seed, 2)
    effects = [*read_effects(effect or [], found), *_at_ends(found, axis, start_mm, end_mm, end_effect)]
    model = virtual.virtual_model(found, errors, calibration, 0.0, effects, draws[0])
    laser = Laser(rate, noise, _vibrations(vibration or []), _settling(settling), jitter * 1e-6, dropped)
    motion = Motion(start_mm, end_mm, feed, acceleration * 1e3, jerk * 1e3, lag * 1e-3)
    targets = Targets(spacing, runs, dwell=dwell)
    with console.status("simulating"):
        measured = measure(
            found, model, axis, motion, laser, targets, Interferometer(u_um=u_um), draws[1], passes=passes, both=both,
            temperatures=virtual.courses_of(temperature or []),
        )  # fmt: skip
    with whole_results(truth, quasistatic, output) as (truth_file, targets_file, file):
        write_records(measured.records, axis, found.name, file)
        write_measurement(measured.quasi, targets_file)
        truth_file.write(encode_model(model))
    samples = sum(map(len, measured.records))
    console.print(
        f"{len(measured.records)} continuous runs with {samples} samples and {len(measured.quasi)} readings at targets "
        f"of {axis}, {len(model.effects)} effects, seed {seed}"
    )


def _check_way(machine: Machine, axis: str, start: float, end: float, spacing: float) -> None:
    """UserError unless the run is that of a linear axis within its travel, with different ends and positive spacing."""
    own = machine.axes[machine.index(axis)]
    if own.rotary:
        raise UserError(f"--axis {axis}: a laser follows linear axes only")
    low, high = own.travel
    for name, place in (("--start-mm", start), ("--end-mm", end)):
        if not low <= place <= high:
            raise UserError(f"{name} {place:g}: outside the travel of {axis}, {low:g} to {high:g} mm")
    if start == end:
        raise UserError(f"--end-mm {end:g}: the run begins there too")
    if spacing <= 0.0:
        raise UserError(f"--spacing {spacing:g}: expected a length above zero")


def _at_ends(machine: Machine, axis: str, start: float, end: float, text: str | None) -> list[Effect]:
    """The effect of `--end-effect`."""
    from calibration.continuous.virtual import end_effect

    if text is None:
        return []
    size, length = options.numbers(text, 2, f"--end-effect {text}", ":")
    if length <= 0.0:
        raise UserError(f"--end-effect {text}: a length above zero, please")
    low, high = sorted((start, end))
    return [end_effect(machine, axis, low, high, size, length)]


def _vibrations(texts: list[str]) -> tuple[tuple[float, float], ...]:
    found = []
    for text in texts:
        frequency, amplitude = options.numbers(text, 2, f"--vibration {text}", ":")
        if frequency <= 0.0:
            raise UserError(f"--vibration {text}: a frequency above zero, please")
        found.append((frequency, amplitude))
    return tuple(found)


def _settling(text: str | None) -> tuple[float, float, float] | None:
    if text is None:
        return None
    frequency, amplitude, constant = options.numbers(text, 3, f"--settling {text}", ":")
    if frequency <= 0.0 or constant <= 0.0:
        raise UserError(f"--settling {text}: a frequency and a time above zero, please")
    return frequency, amplitude, constant
