"""`ncomp simulate-continuous`: a virtual laser that follows an axis in motion, and its quasi-static measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import ncomp
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, option, output_option
from postproc.commands.options.shared import MachineName, Seed, whole_results
from postproc.commands.options.virtual_machine import SIMULATED, VirtualMachineOptions

if TYPE_CHECKING:
    from kinematics.effects import Effect
    from kinematics.machine import Machine

EPILOG = (
    "Examples:\n\n"
    "`ncomp simulate-continuous --machine cframe --axis X --start-mm 0 --end-mm 450 --feed 500 --spacing 90 "
    "-o run.csv --quasistatic targets.csv --truth truth.json`\n\n"
    "`ncomp simulate-continuous --machine gantry --axis X --start-mm 0 --end-mm 2450 --feed 5000 --rate 1000 "
    "--spacing 175 --passes 3 --both --runs 5 --vibration 35:0.3 --settling 18:20:0.2 "
    "--effect backlash:axis=X,width=12 -o run.csv --quasistatic targets.csv`\n\n"
    "then `ncomp continuous run.csv targets.csv -o table.csv`"
)


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Continuous runs of a linear axis."""

    axis: str = option("Linear axis.", "X", default=REQUIRED)
    start_mm: float = option("Start position of the runs, mm.", "mm", default=REQUIRED)
    end_mm: float = option("End position of the runs, mm.", "mm", default=REQUIRED)
    feed: float = option("Programmed feed, mm/min.", "mm/min", default=500.0, min=0.1, panel="Motion")
    acceleration: float = option("Acceleration of the axis, m/s2.", "m/s2", default=1.0, min=1e-3, panel="Motion")
    jerk: float = option("Jerk of the axis, m/s3.", "m/s3", default=50.0, min=1e-2, panel="Motion")
    lag: float = option("Time constant of the position loop, ms.", "ms", default=20.0, min=0.0, panel="Motion")
    passes: int = option("Number of runs.", default=1, min=1, panel="Motion")
    both: bool = option("Run forward and backward each time.", default=False, panel="Motion")


@dataclass(frozen=True, kw_only=True)
class LaserOptions:
    """Sampling of the laser, and its disturbances."""

    PANEL: ClassVar[str] = "Laser"

    rate: float = option("Sampling rate, Hz.", "Hz", default=100.0, min=1.0)
    noise_um: float = option("Standard deviation of a sample, um.", "um", default=0.1, min=0.0)
    vibration: tuple[str, ...] = option("Permanent vibration of the machine, frequency and amplitude: 35:0.3.", "Hz:um")
    settling: str | None = option(
        "Decaying vibration after each ramp, frequency, amplitude and time constant: 18:20:0.2.", "Hz:um:s"
    )
    jitter: float = option("Standard deviation of the time stamps, us.", "us", default=0.0, min=0.0)
    dropped: float = option("Share of lost samples.", "share", default=0.0, min=0.0, max=0.9)


@dataclass(frozen=True, kw_only=True)
class TargetOptions:
    """The quasi-static measurement at targets."""

    PANEL: ClassVar[str] = "Quasi-static measurement"

    spacing: float = option("Distance of the targets, mm.", "mm", default=100.0)
    runs: int = option("Number of cycles, forward and backward.", default=1, min=1)
    dwell: float = option("Dwell at each target, s.", "s", default=4.0, min=0.0)
    u_um: float = option("Standard uncertainty (k=1) of a reading, um.", "um", default=0.2, min=1e-6)


@dataclass(frozen=True, kw_only=True)
class ErrorOptions(VirtualMachineOptions):
    """Errors and temperatures of the virtual machine, with errors at the ends of the run."""

    end_effect: str | None = option("Error at both ends of the run, and its length: 3:20.", "um:mm")

    def at_ends(self, machine: Machine, axis: str, run: RunOptions) -> list[Effect]:
        """The effect of `--end-effect`."""
        from calibration.continuous.virtual import end_effect

        if self.end_effect is None:
            return []
        size, length = numbers(self.end_effect, 2, f"--end-effect {self.end_effect}", ":")
        if length <= 0.0:
            raise UserError(f"--end-effect {self.end_effect}: expected a length above zero")
        low, high = sorted((run.start_mm, run.end_mm))
        return [end_effect(machine, axis, low, high, size, length)]


def simulate_continuous(
    *,
    machine: MachineName,
    run: RunOptions,
    output: str = output_option("File for the continuous runs; `-` is standard output.", "CONTINUOUS.csv"),
    quasistatic: str = option("File for the readings at targets.", "QUASISTATIC.csv", default=REQUIRED, writes="file"),
    laser: LaserOptions,
    targets: TargetOptions,
    errors: ErrorOptions,
    seed: Seed,
) -> None:
    """Simulate laser runs of one axis at constant velocity, and a quasi-static measurement before them."""
    from calibration.continuous.record_file import write_records
    from calibration.measurement.written_file import write_measurement
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import console

    found, axis = ncomp.load_machine(machine), run.axis.strip().upper()
    model = errors.model(found, seed, errors.at_ends(found, axis, run))
    with console.status("simulating"):
        measured = ncomp.simulate_continuous(
            found,
            model,
            **vars(run),
            **vars(laser),
            **vars(targets),
            temperature=errors.courses(),
            seed=seed,
        )
    with whole_results(errors.truth, quasistatic, output) as (truth, readings, file):
        write_records(measured.records, axis, found.name, file, SIMULATED)
        write_measurement(measured.quasi, readings, SIMULATED)
        truth.write(encode_model(model))
    samples = sum(map(len, measured.records))
    console.print(
        f"{len(measured.records)} continuous runs with {samples} samples and {len(measured.quasi)} readings at targets "
        f"of {axis}, {len(model.effects)} effects, seed {seed}"
    )
