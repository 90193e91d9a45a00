"""The drift of a machine in the calibration of watched programs, as its log of touches is now."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration.interface.calibrations import drift
from calibration.interface.measurements import read_measurement
from kinematics.files import fingerprint, read_input
from kinematics.files.inputs import allow_to_replace
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.following.drift import Drift
    from calibration.following.followed import Followed
    from calibration.measurement.measurement import Measurement
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine

    EarlierLogs = Callable[[Machine], Sequence[Measurement]]
    """Earlier logs of touches of a machine."""


class Drifting:
    """The calibration of watched programs, with the drift of the machine.

    The calibration with the drift is written beside the log, LOG.drift.json, when the log changes. Where the drift is
    less than its uncertainty at this moment, the calibration that was given counts.
    """

    def __init__(
        self, log: Path, say: Callable[[str], None], since: str | None, tolerance_um: float | None, earlier: EarlierLogs
    ) -> None:
        self._log, self._say, self._since, self._tolerance_um = log, say, since, tolerance_um
        self._earlier = earlier
        self.output = log.with_suffix(".drift.json")
        self._key: Any = None
        self._corrected: bool | None = None

    _followed: Followed
    _calibration: ErrorModel

    @classmethod
    def of(
        cls,
        log: str | Path | None,
        say: Callable[[str], None],
        since: str | None,
        tolerance_um: float | None,
        earlier: EarlierLogs = lambda _: (),
    ) -> Drifting | None:
        """By a log of touches, and earlier ones; None without one. UserError for what belongs to a log, without one."""
        if log is not None:
            return cls(Path(log), say, since, tolerance_um, earlier)
        for option, value in {"--drift-since": since, "--drift-tolerance-um": tolerance_um}.items():
            if value is not None:
                raise UserError(f"{option} is of the log of touches: give --drift LOG.csv too")
        return None

    def __call__(self, machine: str, calibration: str | None, files: Sequence[Path]) -> str | None:
        """Name of the calibration that counts now; UserError for a log that cannot be used.

        machine, calibration: names of those that are given. files: with changes of these, the drift is estimated again.
        """
        there = [path for path in (self._log, *files) if path.is_file()]
        key = {path: fingerprint(read_input(path, "file")) for path in there if path != self.output}
        if key != self._key:
            self._follow(machine, calibration)
            self._key, self._corrected = key, None
        found = self._now()
        if found.estimate.significant != self._corrected:
            self._take(found)
            self._corrected = found.estimate.significant  # only now: a file that was not written is of an earlier drift
        return str(self.output) if self._corrected else calibration

    def _follow(self, machine: str, calibration: str | None) -> None:
        measurement = read_measurement(self._log, machine)
        if measurement.start is None or measurement.start.tzinfo is None:
            raise UserError(
                f"--drift {self._log}: the programs of now need the times of the touches: a column time with time "
                "stamps, and the zone of their clock ('# zone: Europe/Berlin')"
            )
        found = drift(measurement, calibration, earlier=self._earlier(measurement.machine))
        self._followed, self._calibration = found.followed, found.calibration

    def _now(self) -> Drift:
        from calibration.following.drift import drift_at

        start, last = self._followed.measurement.start, float(self._followed.times[-1])
        assert start is not None
        now = (datetime.datetime.now(datetime.UTC) - start).total_seconds()
        if now < last - datetime.timedelta(minutes=5).total_seconds():
            raise UserError(f"--drift {self._log}: its last reading lies in the future: correct the clock, or its zone")
        since = self._followed.seconds(self._since, "--drift-since")
        if since is not None and since > max(now, last):
            raise UserError(f"--drift-since {self._since}: lies in the future: correct it, or the clock")
        begin = None if since is None else repr(max(since, self._followed.first))
        return drift_at(self._followed, self._calibration, repr(max(now, last)), begin, None, self._tolerance_um)

    def _take(self, found: Drift) -> None:
        from calibration.following.report import drift_verdict
        from kinematics.error_model.model import write_model

        if found.estimate.significant:
            self._refuse_other(self.output)
            allow_to_replace(self.output)  # the corrections read it
            write_model(found.model, self.output)
        for line in drift_verdict(found).splitlines():
            self._say(f"drift by {self._log}: {line}")

    @staticmethod
    def _refuse_other(output: Path) -> None:
        """UserError for a file of this name that is no calibration with a drift."""
        if output.exists() and b"drift by" not in read_input(output, "calibration"):
            raise UserError(f"{output}: the calibration with the drift has this name: rename the file that is there")
