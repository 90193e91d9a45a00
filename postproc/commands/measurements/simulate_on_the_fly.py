"""Simulations on the fly: a virtual tracker that follows a virtual machine along the path of a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, NamedTuple, cast

import typer

from kinematics.user_error import UserError
from postproc.commands.options import strategy as options
from postproc.commands.options.path import PANEL
from postproc.commands.options.shared import whole_results
from postproc.commands.options.virtual_instrument import trackers_of

if TYPE_CHECKING:
    from calibration.measurement.instruments import LaserTracker
    from calibration.on_the_fly.nominal_path import NominalPath
    from calibration.on_the_fly.virtual import Vibration
    from postproc.commands.options.simulation import Simulation

LONG = 200_000
"""Smallest number of readings for which progress is shown."""
MOST = 20_000_000
"""Largest number of readings; more are a mistake in the options."""

DrivenProgram = Annotated[
    str | None,
    typer.Option("--path", metavar="PATH.nc", rich_help_panel=PANEL, help="Follow the path of this program."),
]
Feeds = Annotated[
    list[float] | None,
    typer.Option(
        metavar="mm/min", min=1.0, rich_help_panel=PANEL, help="Default 2500. Repeatable: the program runs at each."
    ),
]
Acceleration = Annotated[
    float, typer.Option(metavar="m/s2", min=1e-3, rich_help_panel=PANEL, help="Along the path; it stops at corners.")
]
Rate = Annotated[float, typer.Option(metavar="Hz", min=0.1, rich_help_panel=PANEL, help="Readings per second.")]
VibrationText = Annotated[
    str | None,
    typer.Option(metavar="Hz:um", rich_help_panel=PANEL, help="Of the machine in motion, RMS in each direction."),
]


class Ride(NamedTuple):
    """Motion along the program, and its observation."""

    feeds: Sequence[float]
    acceleration: float
    """Acceleration, m/s2."""
    rate: float
    vibration: str | None
    targets: list[str]
    trackers: list[str]


def refuse_with_path(options: Mapping[str, object], instrument: str) -> None:
    """UserError for another instrument than a laser tracker, and for options that do not go with a path."""
    if instrument != "laser-tracker":
        raise UserError(f"--path: it takes a laser tracker to follow, not --instrument {instrument}")
    for name, value in options.items():
        if value not in (None, []):
            raise UserError(f"--{name} can't go with --path: the program says where the machine goes")


def simulate_on_path(path: NominalPath, ride: Ride, simulated: Simulation) -> None:
    """Write the readings of a laser tracker, and the true model on request."""
    from calibration.measurement.measurement import SPINDLE_NOSE
    from calibration.on_the_fly.drive import Manner, duration
    from calibration.on_the_fly.virtual import Session, readings_of, write_readings
    from calibration.simulation.measure_plan import check_distance, check_names, tracker_poses
    from calibration.simulation.simulate import spoil
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import console, progress_of, say

    model, draws = simulated.model, simulated.draws
    targets = options.targets_of(ride.targets) if ride.targets else {"1": SPINDLE_NOSE}
    poses, notes = tracker_poses(path.machine, path.positions, trackers_of(ride.trackers), draws[1])
    for note in notes:
        say("note", note)
    check_names(model.effects, targets, list(poses))
    manners = [Manner(feed, 1e3 * ride.acceleration, ride.rate) for feed in ride.feeds]
    passes = len(targets) * len(poses)
    seconds = passes * sum(duration(path, manner) for manner in manners)
    if seconds * ride.rate > MOST:
        raise UserError(f"--rate {ride.rate:g}: {seconds * ride.rate:.3g} readings, more than {MOST}")
    session = Session(path, manners, targets, poses, simulated.stands_on, _vibration(ride.vibration))
    with progress_of(int(seconds * ride.rate), "simulating", LONG) as progress:
        made = readings_of(
            session, model, cast("LaserTracker", simulated.instrument), draws[2],
            noise_scale=simulated.noise_scale, temperatures=simulated.temperatures, progress=progress,
        )  # fmt: skip
    check_distance(made)
    made, spoiled = spoil(made, simulated.faults, draws[3])
    if not len(made):
        raise UserError("--missing leaves no reading")
    output, truth = simulated.outputs
    with whole_results(truth, output) as (truth_file, file):
        write_readings(made, file)
        truth_file.write(encode_model(model))
    for note in spoiled:
        say("simulated", note)
    console.print(
        f"{len(made)} readings in {passes * len(manners)} passes along {path.way[-1] * 1e-3:.2f} m, "
        f"{seconds / 60.0:.1f} min; {len(model.effects)} effects"
    )


def _vibration(text: str | None) -> Vibration:
    from calibration.on_the_fly.virtual import Vibration

    if text is None:
        return Vibration()
    hertz, rms = options.numbers(text, 2, f"--vibration {text}", ":")
    if hertz <= 0.0 or rms < 0.0:
        raise UserError(f"--vibration {text}: expected Hz:um, above zero")
    return Vibration(rms, hertz)
