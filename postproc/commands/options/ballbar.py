"""The options of a virtual ballbar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.options.declared import option
from postproc.commands.options.strategy import targets_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.instruments import Ballbar, Instrument
    from calibration.measurement.measurement import Target
    from calibration.simulation.ballbar import Circles


@dataclass(frozen=True, kw_only=True)
class BallbarOptions:
    """A ballbar and its circles."""

    PANEL: ClassVar[str] = "Ballbar"

    centre: str | None = option("Position of the table ball, mm, workpiece frame with all axes at 0.", "x,y,z")
    plane: tuple[str, ...] = option("Plane of circles: XY, YZ or ZX. Default: XY.", "PLANE")
    arc: str | None = option("First and last angle of the circles, degrees. Default: 0:360.", "low:high")
    bar: str | None = option(
        "Length of the bar, mm, and its standard uncertainty (k=1) by calibration, um: 150:0.5. Without the "
        "uncertainty a fit determines the length. Default: 150.",
        "mm[:um]",
    )

    def refuse(self, instrument: str) -> None:
        """UserError for an option of a ballbar with another instrument."""
        for name in ("centre", "plane", "arc", "bar"):
            if getattr(self, name):
                raise UserError(f"--{name} is no option of --instrument {instrument}: leave it out")

    def instrument(self, of: Instrument) -> Ballbar:
        """The ballbar with these uncertainties and the given length."""
        from calibration.instruments import Ballbar

        own = Ballbar.expect(of)
        if self.bar is None:
            return own
        values = numbers(self.bar, 2 if ":" in self.bar else 1, f"--bar {self.bar}", ":")
        if min(values) <= 0.0:
            raise UserError(f"--bar {self.bar}: expected mm or mm:um, above zero")
        return Ballbar(u_um=own.u_um, length_mm=values[0], length_u_um=values[1] if len(values) > 1 else None)

    def circles(self, feeds: Sequence[float]) -> Circles:
        """The circles at these feeds, mm/min; default 1000."""
        from calibration.simulation.ballbar import Circles

        if self.centre is None:
            raise UserError("--instrument ballbar: the table ball is missing: state --centre x,y,z")
        x, y, z = numbers(self.centre, 3, f"--centre {self.centre}")
        low, high = (0.0, 360.0) if self.arc is None else numbers(self.arc, 2, f"--arc {self.arc}", ":")
        if not low < high <= low + 360.0:
            raise UserError(f"--arc {self.arc}: expected low:high, 360 degrees at most")
        return Circles((x, y, z), self.plane or ("XY",), feeds or (1000.0,), arc_deg=(low, high))

    def target(self, texts: Sequence[str]) -> tuple[str, Target]:
        """The tool ball; UserError unless it is one target on the tool."""
        from calibration.measurement.measurement import SPINDLE_NOSE

        targets = targets_of(texts) or {"t1": SPINDLE_NOSE}
        if len(targets) > 1 or any(target.carrier != "tool" for target in targets.values()):
            raise UserError("--target: a ballbar has one target, its tool ball: t1=x,y,z from the spindle nose")
        return next(iter(targets.items()))
