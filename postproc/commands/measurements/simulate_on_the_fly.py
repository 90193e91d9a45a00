"""Simulations on the fly: a virtual tracker that follows a virtual machine along the path of a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, cast

from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.options.declared import option, refuse_given
from postproc.commands.options.shared import whole_results
from postproc.commands.options.strategy import StrategyOptions
from postproc.commands.options.virtual_instrument import FaultOptions, InstrumentOptions
from postproc.commands.options.virtual_machine import SIMULATED

if TYPE_CHECKING:
    import numpy as np

    from calibration.instruments import LaserTracker
    from calibration.measurement.measurement import Target
    from calibration.on_the_fly.nominal_path import NominalPath
    from calibration.on_the_fly.virtual import Vibration
    from calibration.simulation.measure_plan import VirtualInstrument
    from kinematics.error_model.model import ErrorModel

PROGRESS_READINGS = 200_000
"""Smallest number of readings for which progress is shown."""
MOST_READINGS = 20_000_000
"""Largest number of readings; more are a mistake in the options."""


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """Motion along the path of a program, and its observation."""

    PANEL: ClassVar[str] = "Measurement on the fly"

    path: str | None = option("NC program whose path the machine follows.", "PATH.nc", reads=True)
    feed: tuple[float, ...] = option("Feed, mm/min; the program runs once at each. Default: 2500.", "mm/min", min=1.0)
    acceleration: float = option(
        "Acceleration along the path, m/s2; the motion stops at corners.", "m/s2", default=1.0, min=1e-3
    )
    rate: float = option("Rate of the readings, Hz.", "Hz", default=500.0, min=0.1)
    vibration: str | None = option(
        "Vibration of the machine in motion: frequency, Hz, and RMS amplitude in each direction, um: 35:0.3.", "Hz:um"
    )

    def check(self, strategy: StrategyOptions, instrument: InstrumentOptions, faults: FaultOptions) -> None:
        """UserError for another instrument than a laser tracker, and for options that do not apply to a path."""
        if instrument.instrument != "laser-tracker":
            raise UserError(f"--path needs a laser tracker, not --instrument {instrument.instrument}")
        reason = "does not apply to --path: the program has the positions"
        refuse_given(reason, strategy, "strategy", "points", "spacing", "ranges")
        refuse_given(reason, instrument, "elevation", "incidence", "beam_mm")
        refuse_given(reason, faults, "duplicates")

    def vibrations(self) -> Vibration:
        """The vibration of the machine in motion."""
        from calibration.on_the_fly.virtual import Vibration

        if self.vibration is None:
            return Vibration()
        hertz, rms = numbers(self.vibration, 2, f"--vibration {self.vibration}", ":")
        if hertz <= 0.0 or rms < 0.0:
            raise UserError(f"--vibration {self.vibration}: expected Hz:um, above zero")
        return Vibration(rms, hertz)


def simulate_on_path(
    path: NominalPath,
    motion: MotionOptions,
    targets: Mapping[str, Target],
    model: ErrorModel,
    instrument: VirtualInstrument,
    draws: Sequence[np.random.Generator],
    outputs: tuple[str | None, str],
) -> None:
    """Write the true model on request, and the readings of a laser tracker; draws: as those of the command."""
    from calibration.measurement.measurement import SPINDLE_NOSE
    from calibration.on_the_fly.drive import PathDynamics, duration
    from calibration.on_the_fly.virtual import Session, readings_of, write_readings
    from calibration.simulation.measure_plan import check_distance, check_names, tracker_poses
    from calibration.simulation.simulate import spoil
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import console, progress_of, say

    targets = targets or {"1": SPINDLE_NOSE}
    poses, notes = tracker_poses(path.machine, path.positions, instrument.trackers, draws[1])
    for note in notes:
        say("note", note)
    check_names(model.effects, targets, list(poses))
    rate = motion.rate
    settings = [PathDynamics(feed, 1e3 * motion.acceleration, rate) for feed in motion.feed or (2500.0,)]
    passes = len(targets) * len(poses)
    seconds = passes * sum(duration(path, dynamics) for dynamics in settings)
    if seconds * rate > MOST_READINGS:
        raise UserError(f"--rate {rate:g}: {seconds * rate:.3g} readings, more than {MOST_READINGS}")
    session = Session(path, settings, targets, poses, instrument.stands_on, motion.vibrations())
    with progress_of(int(seconds * rate), "simulating", PROGRESS_READINGS) as progress:
        made = readings_of(
            session, model, cast("LaserTracker", instrument.instrument), draws[2],
            noise_scale=instrument.noise_scale, temperatures=instrument.temperatures, progress=progress,
        )  # fmt: skip
    check_distance(made)
    made, spoiled = spoil(made, instrument.faults, draws[3])
    if not len(made):
        raise UserError("--missing leaves no reading: choose a smaller share")
    with whole_results(*outputs) as (truth, file):
        write_readings(made, file, SIMULATED)
        truth.write(encode_model(model))
    for note in spoiled:
        say("simulated", note)
    console.print(
        f"{len(made)} readings in {passes * len(settings)} passes along {path.feed_distance[-1] * 1e-3:.2f} m, "
        f"{seconds / 60.0:.1f} min; {len(model.effects)} effects"
    )
