"""The public functions that evaluate one kind of measurement, or compare calibrations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from kinematics.running.caller import public
from kinematics.running.given_texts import Texts, header_of, texts
from kinematics.user_error import UserError
from machines.given import load_calibration, load_machine, machine_of
from rendering.shown import Shown

if TYPE_CHECKING:
    from calibration.circles.figures import CircularTest
    from calibration.circles.result import Shares
    from calibration.continuous.axis_model import AxisModel
    from calibration.continuous.estimate import Estimate, TableRows
    from calibration.continuous.reading import Data
    from calibration.continuous.records import QuasiStatic
    from calibration.environment.etve import Etve
    from calibration.evaluation.comparison.result import Comparison
    from calibration.evaluation.rectangle import Rectangle
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.tracker_tests import Fitted
    from calibration.single_axis.iso230 import AxisTest
    from calibration.single_axis.three_points import ThreePoints
    from calibration.single_axis.three_points_check import Check
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from kinematics.transforms import Array


@public
def compare(
    a: str | Path | ErrorModel,
    b: str | Path | ErrorModel,
    machine: str | Path | Machine | None = None,
    *,
    straightness: Literal["end-point", "least-squares"] = "end-point",
    reference: Texts = (),
    tool_mm: Annotated[float, 0, None] = 100.0,
) -> Comparison:
    """Two calibrations of one machine, error motion by error motion, by ISO 230-1; differences, um, are b minus a.

    machine: by default the shipped machine of `a`; straightness: reference line of the straightness errors; reference:
    positions of axes, mm or degrees, at which their errors are zero (`{"X": 0}`), by default their home positions;
    tool_mm: length of the tool in the volume, mm.

    UserError for calibrations of different machines.
    """
    from calibration.evaluation.comparison.compare import compare

    found = _machine_of(a, b, machine)
    models = load_calibration(found, a), load_calibration(found, b)
    return compare(found, models, straightness, _references(found, reference), tool_mm)


def _machine_of(
    a: str | Path | ErrorModel, b: str | Path | ErrorModel, machine: str | Path | Machine | None
) -> Machine:
    """The machine of two calibrations; UserError where they are of different machines."""
    from kinematics.error_model.model import decode_model
    from kinematics.files import read_input

    models = [
        decode_model(read_input(Path(each), "calibration"), str(each)) if isinstance(each, (str, Path)) else each
        for each in (a, b)
    ]
    names = [str(each) if isinstance(each, (str, Path)) else each.id for each in (a, b)]
    first, second = (model.machine for model in models)
    if first.chain_hash != second.chain_hash:
        geometry = " with another geometry" if (first.name, first.chain) == (second.name, second.chain) else ""
        raise UserError(
            f"{names[0]} is of machine {first.name} ({first.chain}), {names[1]} of {second.name} ({second.chain})"
            f"{geometry}: only calibrations of one machine can be compared"
        )
    return machine_of(models[0], machine, names[0])


def _references(machine: Machine, given: Texts) -> dict[str, float]:
    """Reference positions by axis, mm or degrees."""
    found: dict[str, float] = {}
    for text in texts(given):
        axis, equals, value = (part.strip() for part in text.partition("="))
        try:
            position = float(value)
        except ValueError:
            position = float("nan")
        if not equals or not isfinite(position):
            raise UserError(f"--reference {text}: expected AXIS=POSITION, as in X=0")
        if axis not in machine.names:
            raise UserError(f"--reference {text}: {machine.name} ({machine.chain}) has no axis {axis}")
        if axis in found:
            raise UserError(f"--reference {text}: {axis} is given twice: give it once")
        found[axis] = position
    return found


@public
def iso230(measurement: Measurement) -> tuple[AxisTest, ...]:
    """Interferometer runs by ISO 230-2, axis by axis: reversal, repeatability and accuracy, um or urad, with U (k = 2).

    Deviations are measured minus target, positive where the axis goes too far in its positive direction. Points of a
    tracker along the body diagonals are evaluated by ISO 230-6, diagonal by diagonal.

    UserError for the measurement of another instrument, and for readings whose direction of approach is unknown.
    """
    from calibration.single_axis.diagonals import diagonal_tests
    from calibration.single_axis.iso230 import evaluate
    from calibration.single_axis.other_standards import with_others

    tests = diagonal_tests(measurement) if measurement.instrument.BY_BEAM else evaluate(measurement)
    return tuple(map(with_others, tests))


@dataclass(frozen=True, repr=False)
class CircularTests(Shown):
    """Circles of a ballbar by ISO 230-4, and the share of each cause in their deviations."""

    tests: Sequence[CircularTest]
    """Figures of each plane, um, with U (k = 2)."""
    shares: Shares
    """Causes, their sizes and shares, and the deviation that they leave, um."""
    notes: tuple[str, ...]
    """Notes for the user."""
    measurement: Measurement
    """The measurement that was evaluated."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        causes = ", ".join(f"{each.name} {100.0 * each.share:.0f} %" for each in self.shares.causes[:3])
        return f"{self.measurement.machine.name}: {causes or 'no cause is significant'}"

    def json(self) -> dict[str, Any]:
        """The result for programs."""
        from calibration.reports.ballbar import ballbar_json

        return ballbar_json(self.tests, self.shares)


@public
def ballbar(measurement: Measurement) -> CircularTests:
    """Circles of a ballbar by ISO 230-4, with the share of each cause: backlash, spikes, play, squareness, ...

    UserError for the measurement of another instrument.
    """
    from calibration.circles.circles import ballbar_of, circles_of, one_way_planes
    from calibration.circles.figures import circular_tests
    from calibration.circles.shares import shares
    from calibration.plausibility.checks import usable

    ballbar_of(measurement)
    notes = [finding.message for finding in usable(measurement)]
    circles = circles_of(measurement)
    notes += [
        f"plane {plane} was measured in one direction only: there backlash, lateral play and reversal spikes are not "
        "certain, because other error motions act alike; measure both directions"
        for plane in one_way_planes(circles)
    ]
    return CircularTests(circular_tests(measurement, circles), shares(measurement, circles), tuple(notes), measurement)


@public
def square(
    ac: float,
    bd: float,
    ad: float,
    *,
    ab: float | None = None,
    u: float = 0.5,
    plane: str = "XY",
) -> Rectangle:
    """The squareness of two axes from the diagonals ac, bd and the side ad of a rectangle that the machine made, mm.

    A is the corner from which ad goes along the first axis of the plane, and ab along the second one (XY, XZ or YZ); u:
    standard uncertainty (k = 1) of each length, mm. `calibration(machine)` of the result is for `correct`.

    UserError for lengths that are not those of a rectangle.
    """
    from calibration.evaluation.rectangle import Rectangle

    return Rectangle(ac, bd, ad, ab, u, plane)


@public
def tracker(data: str | Path) -> Fitted:
    """The standard uncertainties (k = 1) of a laser tracker, um and um/m, from its tests by ASME B89.4.19.

    data: file with the columns of `ncomp tracker`. UserError with the line of the first test that cannot be used.
    """
    from calibration.measurement.tracker_tests import fit_tests, read_tests

    return fit_tests(read_tests(Path(data)))


@public
def etve(data: str | Path, *, period_h: Annotated[float, 1e-3, None] | None = None) -> Etve:
    """The environmental temperature variation error (ISO 230-3) of a standing machine, um and urad, with U (k = 2).

    data: log with the columns of `ncomp etve`; period_h: time, h, that a measurement takes, by default the whole log.
    UserError with line and column for a log that cannot be used, and for a period beyond it.
    """
    from calibration.environment.etve import read_etve

    return read_etve(Path(data), period_h)


@dataclass(frozen=True, repr=False)
class ThreePointsResult(Shown):
    """Error motions of each axis from three targets, and the check of their model."""

    found: ThreePoints
    """Error motions, mm and rad, axis by axis."""
    check: Check
    """Residuals with the model and without it, um, and the cross-validation."""
    measurement: Measurement
    """The measurement that was evaluated."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        axes, before = ", ".join(self.found.axes), self.check.before_rms_um
        return f"{self.measurement.machine.name}, axes {axes}, before {before:.3g} um RMS"

    @property
    def model(self) -> ErrorModel:
        """The calibration."""
        return self.found.model

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user."""
        return self.found.notes


@public
def three_points(
    measurement: Measurement, *, basis: Literal["polynomial", "table"] = "polynomial", degree: Texts = ()
) -> ThreePointsResult:
    """The six error motions of each axis from three or more targets on the part that it moves; `model` of the result.

    basis: form of the error motions; degree: degrees of polynomials by error motion (`{"XX": 4}`), by default the data
    decide.

    UserError for a tracker that is not on the bed, for targets in one line, and for a model that is no improvement.
    """
    from calibration.fit.acceptance import refuse_uncertain
    from calibration.single_axis.three_points import Choice, identify
    from calibration.single_axis.three_points_check import check

    choice = Choice(basis, _degrees(degree))
    found = identify(measurement, choice)
    refuse_uncertain(found.model, measurement)
    return ThreePointsResult(found, check(measurement, found, choice), measurement)


def _degrees(given: Texts) -> dict[str, int]:
    """Degrees of polynomials by error motion, XX ... CC."""
    degrees = {}
    for text in texts(given):
        name, _, number = text.partition("=")
        if not number.strip().isdigit():
            raise UserError(f"--degree {text}: expected NAME=DEGREE, as in XX=4")
        degrees[name.strip().removeprefix("E_")] = int(number)
    return degrees


@dataclass(frozen=True, repr=False)
class ContinuousResult(Shown):
    """Laser runs in motion and quasi-static data of one axis, joined."""

    data: Data
    """The content of the files."""
    estimate: Estimate
    """The positioning error along the axis, um, with its uncertainty, and the features of the runs."""
    calibration: AxisModel | None
    """The estimate as a calibration; None without a machine."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        rows = self.table
        low, high, u = rows.error.min(), rows.error.max(), 2.0 * rows.u.max()
        return f"{self.data.axis}: error {low:.3g} to {high:.3g} um, U (k=2) at most {u:.2g} um"

    @property
    def columns(self) -> dict[str, Array]:
        """The error table: position_mm, error_um and u_um (k = 1) by name `(n,)`."""
        return {"position_mm": self.table.position, "error_um": self.table.error, "u_um": self.table.u}

    @property
    def table(self) -> TableRows:
        """The error table: positions, mm, errors and their standard uncertainties (k = 1), um."""
        return self.estimate.table()

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user."""
        of_calibration = () if self.calibration is None else self.calibration.notes
        return (*self.data.notes, *self.estimate.notes, *of_calibration)


@public
def continuous(
    data: Sequence[str | Path],
    machine: str | Path | Machine | None = None,
    *,
    spacing_mm: float | None = None,
    direction: Literal["auto", "forward", "backward", "mean"] = "auto",
    run: str | Sequence[str] = (),
    header: Texts | None = None,
    add_to: str | Path | ErrorModel | None = None,
) -> ContinuousResult:
    """Laser runs at constant velocity joined with a quasi-static measurement of the same axis: one fine table.

    data: files of both kinds, which their columns distinguish; machine: with it the result has a calibration with the
    errors of both directions; spacing_mm: distance of the rows of the table, mm, by default for about 500 rows;
    direction: runs in this direction, or the mean of both; `auto` takes the mean where there are both; run: names of
    the quasi-static runs to use, by default all; header: keys that the files lack; add_to: a calibration in which the
    errors along this axis are replaced.

    UserError for data without a run of each kind, and for data of another machine or axis.
    """
    from calibration.continuous.estimate import estimate
    from calibration.continuous.reading import read_all

    if spacing_mm is not None and spacing_mm <= 0.0:
        raise UserError(f"--spacing-mm {spacing_mm:g}: expected a length above zero")
    entries = header_of(header or ())
    read = read_all([Path(path) for path in data], entries)
    quasi = _runs(read.quasi, [run] if isinstance(run, str) else run)
    found = estimate(read.records, quasi, spacing_mm, direction)
    made = None if machine is None else _axis_model(found, read, quasi, load_machine(machine), add_to, entries)
    return ContinuousResult(read, found, made)


def _axis_model(
    found: Estimate,
    read: Data,
    quasi: QuasiStatic,
    machine: Machine,
    add_to: str | Path | ErrorModel | None,
    header: Mapping[str, str],
) -> AxisModel:
    """The estimate as a calibration of the machine; UserError where the data are of another machine or axis."""
    from calibration.continuous.axis_model import axis_model, line_of
    from calibration.measurement.readers import read_any

    files = ", ".join(read.fingerprints)
    if read.machine not in ("", machine.name):
        raise UserError(
            f"{files}: the data are of machine {read.machine}, and --machine is {machine.name}: give the machine of "
            "the data"
        )
    if read.axis not in machine.names:
        raise UserError(
            f"{files}: {machine.name} ({machine.chain}) has no axis {read.axis}: give the machine of the data, or "
            "correct the entry axis of their header"
        )
    base = None if add_to is None else load_calibration(machine, add_to)
    line = line_of([read_any(path, machine, header=header) for path in read.standing], read.axis)
    return axis_model(found, read, quasi, machine, line, base)


def _runs(quasi: QuasiStatic, chosen: Sequence[str]) -> QuasiStatic:
    """The readings of the requested runs, all of them by default; UserError for an unknown run."""
    import numpy as np

    unknown = [name for name in chosen if name not in quasi.runs]
    if unknown:
        raise UserError(f"--run {unknown[0]}: {quasi.source} has runs {', '.join(quasi.runs)}: give one of them")
    return quasi.rows(np.flatnonzero(np.isin(quasi.run, list(chosen)))) if chosen else quasi
