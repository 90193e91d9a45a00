"""Results as entries."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from history.entries import FoundCause, Quantity, Result
from kinematics.error_model.model import decode_model, refuse_other_machine
from kinematics.files import fingerprint
from kinematics.files.inputs import fingerprint_as_read
from kinematics.machine import Machine
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable


def instant(day: datetime.date | None, made_at: datetime.datetime | None = None) -> datetime.datetime:
    """The point of time of a result: when it was made, unless the measurement is of another day, which then begins."""
    made = made_at or datetime.datetime.now(datetime.UTC)
    if day is None or day in (made.date(), made.astimezone().date()):
        return made
    return datetime.datetime.combine(day, datetime.time(), datetime.UTC)


def fingerprints(paths: Iterable[str | Path | None]) -> dict[str, str]:
    """The fingerprints of files, as they were read, by their paths."""
    files = [Path(path) for path in paths if path not in (None, "-")]
    return {str(path): fingerprint_as_read(path) or fingerprint(path.read_bytes()) for path in files if path.is_file()}


def of_calibration(
    machine: Machine,
    content: bytes,
    name: str,
    *,
    kind: str = "calibration",
    method: str = "",
    files: Mapping[str, str],
    at: datetime.datetime | None = None,
    title: str = "",
    causes: Sequence[FoundCause] = (),
) -> Result:
    """The entry of a calibration file; UserError for that of another machine."""
    from history.figures import of_calibration, of_effects

    model = decode_model(content, name)
    refuse_other_machine(model, machine, name)
    if model.machine.name != machine.name:
        raise UserError(
            f"calibration {name} is of machine {model.machine.name}, not of {machine.name}: enter it into the life of "
            f"{model.machine.name}"
        )
    measured = model.provenance.measured_on
    day = None if measured is msgspec.UNSET else measured
    figures = of_effects(machine, model.effects) if kind == "check" else of_calibration(machine, model)
    return Result(
        kind=kind,
        at=at or instant(day, model.provenance.made_at),
        title=title or f"{kind} {model.id}, {model.provenance.source or name}",
        method=method,
        document=content,
        figures=figures,
        causes=causes,
        files=files,
    )


def of_results(
    kind: str,
    title: str,
    results: Mapping[str, object],
    figures: Iterable[Quantity],
    *,
    method: str,
    files: Mapping[str, str],
    at: datetime.datetime,
    causes: Sequence[FoundCause] = (),
) -> Result:
    """The entry of results for programs."""
    document = msgspec.json.format(msgspec.json.encode(results), indent=1)
    return Result(
        kind=kind,
        at=at,
        title=title,
        method=method,
        document=document,
        figures=tuple(figures),
        causes=causes,
        files=files,
    )
