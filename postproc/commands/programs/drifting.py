"""The options of a watch that follows the drift of its machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from postproc.commands.options.declared import MODEL, option

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from kinematics.machine import Machine
    from postproc.commands.options.recorded import HistoryOptions
    from postproc.interface.request import Request


@dataclass(frozen=True, kw_only=True)
class DriftOptions:
    """The log of touches by which watched programs are corrected."""

    PANEL: ClassVar[str] = MODEL

    drift: Path | None = option(
        "Log of touches, as of ncomp drift: programs are corrected for the drift since its first reading as "
        "well. The calibration with it is LOG.drift.json.",
        "LOG.csv",
        reads=True,
    )
    drift_since: str | None = option(
        "Time at which the work offsets were touched off, by the clock of the log; default: the first reading. A run "
        "of the log that begins later counts from its own first reading.",
        "TIME",
    )
    drift_tolerance_um: float | None = option(
        "Largest uncertainty U (k=2) of the drift, um; beyond it programs wait until the sphere is touched again.",
        "UM",
        min=0.0,
    )

    @property
    def given(self) -> bool:
        """True with any option."""
        return any(each is not None for each in (self.drift, self.drift_since, self.drift_tolerance_um))

    def requests(
        self, given: Callable[[], Request], say: Callable[[str], None], history: HistoryOptions
    ) -> Callable[[], Request]:
        """The request of watched programs, with the drift by the log if there is one, and by earlier ones.

        UserError for options of the log without one.
        """
        from calibration.interface.drifting import Drifting
        from postproc.commands.options.earlier_touches import earlier_touches
        from postproc.interface.request import with_calibration

        def earlier(machine: Machine) -> list[Measurement]:
            return earlier_touches(machine, history.address(machine))

        drifting = Drifting.of(self.drift, say, self.drift_since, self.drift_tolerance_um, earlier)
        return with_calibration(given, drifting)
