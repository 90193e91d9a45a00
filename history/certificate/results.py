"""The results that a certificate states, from a calibration or from the results of ISO 230-2."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from history.certificate.details import Details
from history.entries import Quantity
from history.figures import of_axes, of_comparison
from kinematics.effects import after_touch_off
from kinematics.error_model.model import ErrorModel, decode_model, no_errors, refuse_other_machine
from kinematics.files import read_input
from kinematics.machine import Machine
from kinematics.user_error import UserError
from machines.given import machine_of

NO_MACHINE = "The result comes from a simulated or demonstration calibration: it describes no real machine."


@dataclass(frozen=True)
class Curve:
    """Values at positions of an axis."""

    name: str
    unit: str
    position_unit: str
    positions: Sequence[float]
    values: Sequence[float]
    U: Sequence[float] = ()
    """Expanded uncertainties, k = 2; empty where the result has none."""


@dataclass(frozen=True)
class Results:
    """What a certificate states."""

    title: str
    machine: str
    norms: tuple[str, ...]
    document: bytes
    name: str
    """Name of the document's file."""
    figures: Sequence[Quantity]
    curves: Sequence[Curve]
    remarks: tuple[str, ...] = ()
    measured: datetime.date | None = None
    """First day of the measurement, where the document has it."""
    temperatures: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Lowest and highest temperature of each sensor, degC."""

    def fitting(self, details: Details, where: str) -> Results:
        """The results with the conditions of the details; UserError where these are of another machine or time."""
        head, machine = details.certificate, details.machine.name
        if machine != self.machine:
            raise UserError(f"{where}: machine.name is {machine!r}, and {self.name} is of {self.machine!r}")
        if self.measured is not None and not head.begin <= self.measured <= head.end:
            raise UserError(
                f"{where}: {self.name} was measured on {self.measured}, not from {head.begin} to {head.end}"
            )
        if not self.temperatures and head.temperatures_degC is None:
            raise UserError(f"{where}: certificate.temperatures_degC is missing: write [lowest, highest] of the place")
        stated = {} if head.temperatures_degC is None else {"place": head.temperatures_degC}
        return replace(self, temperatures=stated | dict(self.temperatures))


def read_results(path: Path, machine: str | None) -> Results:
    """The results in a calibration or in a file of `ncomp iso230 --json`; UserError where they cannot be certified.

    machine: of a calibration; by default the shipped one of its name.
    """
    document = read_input(path, "calibration or results")
    if b'"ncomp_calibration"' not in document:
        return _positioning(document, path)
    model = decode_model(document, str(path))
    return _calibration(machine_of(model, machine, str(path)), model, document, path)


def _calibration(machine: Machine, model: ErrorModel, document: bytes, path: Path) -> Results:
    """The error motions and figures of a calibration, as `ncomp compare` has them against a machine without errors."""
    from calibration.evaluation.comparison.compare import compare

    refuse_other_machine(model, machine, str(path))
    unknown = [effect.name for effect in model.effects if not any(effect.uncertainties)]
    if unknown or not model.effects:
        raise UserError(
            f"{path}: the uncertainty of {', '.join(unknown) or 'the calibration'} is missing: a certificate states U "
            "of each result; fit the calibration to measurements with 'ncomp fit'"
        )
    if drifts := [effect.name for effect in model.effects if after_touch_off(effect)]:
        raise UserError(
            f"{path}: {', '.join(drifts)}: a drift since the touch-off, which changes with time: certify the "
            "calibration without the drift"
        )
    found = compare(machine, (no_errors(machine), model))
    u, error = found.volume.u_rms_um, found.volume.difference.rms
    if u >= error:
        raise UserError(
            f"{path}: the calibration is worse than none: its standard uncertainty over the volume is {u:.3g} um RMS, "
            f"and the errors that it states are {error:.3g} um RMS: measure with a smaller uncertainty"
        )
    curves = [
        Curve(each.name, each.unit, each.position_unit, each.positions.tolist(), each.b.tolist(), each.U_b.tolist())
        for each in found.motions
    ]
    remarks = [NO_MACHINE] if model.invented else []
    remarks += [f"Not certified: {each}" for each in found.left_out]
    day = None if model.provenance.measured_on is msgspec.UNSET else model.provenance.measured_on
    return Results(
        f"Error motions of {machine.name}", machine.name, ("ISO 230-1:2012",), document, path.name,
        of_comparison(machine, found), curves, tuple(remarks), day, model.temperatures,
    )  # fmt: skip


def _positioning(document: bytes, path: Path) -> Results:
    """The values and mean deviations of ISO 230-2."""
    try:
        found: dict[str, Any] = msgspec.json.decode(document)
        axes, machine = found["axes"], found["provenance"]["machine"]
        figures = of_axes(axes)
        curves = [curve for test in axes for curve in _deviations(test)]
        remarks = [note for test in axes for note in (*test["notes"], *_astray(test))]
    except (msgspec.DecodeError, LookupError, TypeError, AttributeError, StopIteration):
        raise UserError(
            f"{path}: neither a calibration nor results of 'ncomp iso230 --json': only these have certificates"
        ) from None
    unknown = [each.name for each in figures if not each.u > 0.0]
    if unknown or not figures:
        raise UserError(
            f"{path}: the uncertainty of {', '.join(unknown) or 'the values'} is missing: a certificate states U of "
            "each result; give the data u_um, and evaluate them again"
        )
    diagonals = any(not test["axis"].isalnum() for test in axes)
    norms = "ISO 230-6:2002" if diagonals else "ISO 230-2:2014", "ISO/TR 230-9:2005"
    title = f"Accuracy and repeatability of positioning of {machine}"
    return Results(title, machine, norms, document, path.name, figures, curves, tuple(remarks))


def _astray(test: Mapping[str, Any]) -> Iterator[str]:
    """A remark on the readings of an axis that disagree with the others."""
    if count := len(test["astray"]):
        yield f"{test['axis']}: {count} readings disagree with the others of their target, and count in all values"


def _deviations(test: Mapping[str, Any]) -> Iterator[Curve]:
    """The mean deviations of an axis at its targets, by direction."""
    position = next(key for key in test["targets"][0] if key.startswith("position_"))
    for direction in ("forward", "backward"):
        rows = [(each[position], each[direction]) for each in test["targets"] if each[direction]["runs"]]
        if rows:
            mean = next(key for key in rows[0][1] if key.startswith("mean_"))
            yield Curve(
                f"mean deviation {test['axis']} {direction}", mean.removeprefix("mean_"),
                position.removeprefix("position_"), [at for at, _ in rows], [cell[mean] for _, cell in rows],
            )  # fmt: skip


def largest(curve: Curve) -> int:
    """Row of the largest value of a curve."""
    return int(np.argmax(np.abs(curve.values)))
