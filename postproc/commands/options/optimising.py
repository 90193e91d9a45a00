"""The options of `ncomp plan --optimise`, and the optimised plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from kinematics.user_error import UserError
from postproc.commands.options.declared import numbers, option
from postproc.commands.options.strategy import counts
from postproc.commands.options.virtual_instrument import TrackerOptions

if TYPE_CHECKING:
    from calibration.measurement.plan import Choices, Plan
    from calibration.optimal.candidates import Obstacle
    from kinematics.machine import Machine


@dataclass(frozen=True, kw_only=True)
class OptimisingOptions(TrackerOptions):
    """A plan with the least volumetric uncertainty."""

    PANEL: ClassVar[str] = "Optimised plan"

    optimise: bool = option(
        "Select the positions that leave the least volumetric uncertainty, for --points or --minutes.", default=False
    )
    obstacle: tuple[str, ...] = option(
        "Box without targets that no beam may cross, mm, workpiece frame.", "x=low:high,y=...,z=..."
    )
    visible: tuple[str, ...] = option(
        "Effect of docs/effects.md that the measurement must determine to 30 % of its typical size.",
        "kind:field=value,...",
    )
    candidates: int = option(
        "Number of positions from which the plan is selected.", "N", default=2000, min=100, max=20_000
    )

    def plan(self, machine: Machine, choices: Choices, points: str | None, minutes: float | None) -> Plan:
        """The plan; the terminal shows its predicted uncertainty."""
        from calibration.optimal.optimise import Request, optimised
        from calibration.simulation.effect_text import read_effects
        from postproc.commands.show.terminal import console

        count = counts(points)
        if isinstance(count, list):
            raise UserError(f"--points {points}: --optimise takes one number")
        request = Request(
            choices,
            count,
            minutes,
            self.trackers,
            self.reach,
            [_obstacle(text) for text in self.obstacle],
            read_effects(self.visible, machine, "--visible"),
            self.candidates,
        )
        with console.status("optimising") as status:
            found = optimised(machine, self.instrument_of("laser-tracker"), request, status.update)
        console.print(
            f"tracker      {','.join(f'{v:g}' for v in found.tracker)} (mm, workpiece frame)\n"
            f"expected     {found.expected_um:.2f} um RMS of volumetric error, for errors of typical size"
        )
        for name, share in found.visible.items():
            console.print(f"visible      {name}: to {share:.0%} of its typical size (k = 1)")
        return found.plan


def _obstacle(text: str) -> Obstacle:
    from calibration.optimal.candidates import obstacle_of

    box: dict[str, tuple[float, float]] = {}
    for entry in text.split(","):
        letter, _, ends = entry.partition("=")
        low, high = numbers(ends, 2, f"--obstacle {text}", ":")
        if letter.strip() in box:
            raise UserError(f"--obstacle {text}: {letter.strip()} is given twice: give it once")
        box[letter.strip()] = (low, high)
    try:
        return obstacle_of(box)
    except UserError as fault:
        raise UserError(f"--obstacle {text}: {fault}") from None
