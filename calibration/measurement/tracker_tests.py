"""A laser tracker's standard uncertainties from its tests by ASME B89.4.19: ranging, length and two-face.

The model is that of `LaserTracker`: along the beam r = u_range + u_range_per_m D, across it a = u_angle +
u_angle_per_m D in either direction. Variances of the measured quantities, to first order:

    ranging    length between two points in line with the tracker:      r(D1)^2 + r(D2)^2
    length     bar of length L across the beam, centre at D:            2 (c^2 r(d)^2 + (1 - c^2) a(d)^2),
                                                                        d^2 = D^2 + L^2 / 4, c = L / 2 d
    two-face   distance of the two faces' points, two components:       2 a(D)^2 each, so its mean square is 4 a(D)^2

Measured errors are fitted by maximum likelihood; stated values (of an instrument specification, with a coverage factor
k) by least squares of their logarithms, as in the virtual calibration paper (2.2.2, Figure 3 and Table 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import special

from calibration.instruments import LaserTracker
from calibration.measurement.text_table import Table, parse_table
from kinematics.files import read_input
from kinematics.files.mistaken import kind_of_file
from kinematics.transforms import Array
from kinematics.user_error import UserError
from rendering.shown import Shown

KINDS = ("ranging", "length", "two-face")
PARAMETERS = ("u_range_um", "u_range_um_per_m", "u_angle_um", "u_angle_um_per_m")
TRACKER_STARTS = ((1.0, 0.5, 5.0, 2.0), (0.1, 1.0, 0.5, 5.0), (5.0, 0.05, 20.0, 0.5))
ZERO_PARAMETER_UM = 1e-6
"""Smallest parameter, um or um/m; smaller ones count as zero."""
SHORTEST_RANGE_M = 0.1
"""Smallest range of a test, m."""
LEAST_TRACKER_UM, LARGEST_TRACKER_UM = 0.01, 1000.0
"""Limits of a tracker's errors, um; values beyond them are in another unit."""
DOUBTFUL_TESTS_P = 1e-3
"""Probability of a chi2 below which the tests do not fit the model."""


@dataclass(frozen=True)
class TrackerTests:
    """Tests of a tracker, one row for each."""

    kind: np.ndarray
    """Kind of each test `(n,)`, one of KINDS."""
    ranges: Array
    """Ranges of the two ends of the length `(n, 2)`, m; equal in other tests."""
    along: Array
    """Squared share of the length along the beam `(n,)`: 1 for ranging, 0 for two-face tests."""
    value: Array
    """Measured errors or stated values `(n,)`, um."""
    coverage: float | None
    """Coverage factor k of stated values; None for measured errors."""
    source: str

    @property
    def dof(self) -> Array:
        """Number of components of each value `(n,)`."""
        return np.where(self.kind == "two-face", 2.0, 1.0)

    def variances(self, parameters: Array) -> Array:
        """Variances of each component `(n,)`, um2, from the four parameters."""
        r = parameters[0] + parameters[1] * self.ranges
        a = parameters[2] + parameters[3] * self.ranges
        return np.asarray(np.sum(self.along[:, None] * r**2 + (1.0 - self.along[:, None]) * a**2, axis=1))

    def slopes(self, parameters: Array) -> Array:
        """Derivatives `(n, 4)` of the variances by the parameters."""
        r = parameters[0] + parameters[1] * self.ranges
        a = parameters[2] + parameters[3] * self.ranges
        by_r, by_a = 2.0 * self.along[:, None] * r, 2.0 * (1.0 - self.along[:, None]) * a
        parts = [by_r, by_r * self.ranges, by_a, by_a * self.ranges]
        return np.stack([part.sum(axis=1) for part in parts], axis=1)


@dataclass(frozen=True, repr=False)
class Fitted(Shown):
    """The tracker's parameters, um and um/m, k = 1."""

    tests: TrackerTests
    """The tests that were fitted."""
    parameters: Array
    """Standard uncertainties (k = 1) `(4,)` of range, um and um/m, and across the beam, um and um/m."""
    u: Array
    """Standard uncertainties of the parameters `(4,)`."""
    predicted: Array
    """Predicted RMS of each value `(n,)`, um."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        values = zip(PARAMETERS, self.parameters.tolist(), strict=True)
        return ", ".join(f"{name} {value:.3g}" for name, value in values)

    @property
    def instrument(self) -> LaserTracker:
        """The tracker with these uncertainties."""
        return LaserTracker(*self.parameters.tolist())

    def chi2(self, kind: str) -> tuple[float, int]:
        """chi2 of the measured errors of one kind, and its degrees of freedom."""
        rows = self.tests.kind == kind
        dof = self.tests.dof[rows]
        return float(np.sum(dof * (self.tests.value[rows] / self.predicted[rows]) ** 2)), int(dof.sum())

    def doubtful(self, kind: str) -> bool:
        """True if measured errors of a kind are significantly larger than predicted."""
        value, dof = self.chi2(kind)
        return self.tests.coverage is None and dof > 0 and float(special.chdtrc(dof, value)) < DOUBTFUL_TESTS_P


def read_tests(path: Path) -> TrackerTests:
    """The tests in a file: columns test, range_mm, range_2_mm (ranging), length_mm (length), error_um or stated_um.

    UserError with line and column for unusable cells.
    """
    data = read_input(path, "tests of a tracker")
    if found := kind_of_file(data):
        raise UserError(f"{path}: this is {found}, no tests of a tracker: give a CSV file of the tests")
    table = parse_table(data, str(path))
    known = ["test", "range_mm", "range_2_mm", "length_mm", "error_um", "stated_um"]
    table.allow_columns(lambda name: name in known, known)
    table.need_columns(["test", "range_mm"], "tests of a tracker")
    if ("error_um" in table.names) == ("stated_um" in table.names):
        raise UserError(
            f"{table.head}: one column, error_um (measured) or stated_um (of an instrument specification), is expected"
        )
    kind = table.texts(["test"])["test"]
    unknown = np.flatnonzero(~np.isin(kind, KINDS))
    if len(unknown):
        table.fault(int(unknown[0]), "test", f"{str(kind[unknown[0]])!r} is none of {', '.join(KINDS)}")
    near = table.numbers(["range_mm"])["range_mm"] * 1e-3
    if np.any(near <= 0.0):
        table.fault(int(np.argmax(near <= 0.0)), "range_mm", "a range must be above 0")
    if np.any(near < SHORTEST_RANGE_M):
        table.fault(
            int(np.argmax(near < SHORTEST_RANGE_M)),
            "range_mm",
            "a range below 100 mm is too short for a test of a tracker: is the unit mm?",
        )
    far = _own(table, "range_2_mm", kind == "ranging") * 1e-3
    half = _own(table, "length_mm", kind == "length") * 0.5e-3
    ends = np.where(kind == "ranging", far, np.hypot(near, half))
    starts = np.where(kind == "ranging", near, ends)
    along = np.where(kind == "ranging", 1.0, (half / ends) ** 2)
    value, coverage = _read_values(table)
    return TrackerTests(kind, np.stack([starts, ends], axis=1), along, value, coverage, str(path))


def _read_values(table: Table) -> tuple[Array, float | None]:
    """Measured errors or stated values `(n,)`, um, and the coverage of stated ones; UserError for other units."""
    name = "error_um" if "error_um" in table.names else "stated_um"
    value, coverage = table.numbers([name])[name], _coverage(table) if name == "stated_um" else None
    if coverage is not None and np.any(value <= 0.0):
        table.fault(int(np.argmax(value <= 0.0)), name, "a stated value must be above 0")
    if np.any(np.abs(value) > LARGEST_TRACKER_UM):
        table.fault(
            int(np.argmax(np.abs(value) > LARGEST_TRACKER_UM)),
            name,
            "more than 1 mm is too large for an error of a tracker: is the unit um?",
        )
    if not np.any(np.abs(value) > LEAST_TRACKER_UM):
        raise UserError(
            f"{table.source}: every {name} is below {LEAST_TRACKER_UM:g} um, less than the errors of any tracker: is "
            "the unit um?"
        )
    return value, coverage


def fit_tests(tests: TrackerTests) -> Fitted:
    """Parameters of the tracker; UserError if tests of ranges or of angles are missing or too few."""
    from scipy.optimize import minimize

    _refuse_unidentifiable(tests)
    objective = _likelihood if tests.coverage is None else _logarithms
    bounds = [(ZERO_PARAMETER_UM, None)] * 4
    tried = [
        minimize(objective, start, (tests,), jac=True, method="L-BFGS-B", bounds=bounds) for start in TRACKER_STARTS
    ]
    best = min(tried, key=lambda one: float(one.fun)).x
    parameters = np.where(best <= 2.0 * ZERO_PARAMETER_UM, 0.0, best)
    predicted = np.sqrt(tests.variances(best) * tests.dof)
    return Fitted(tests, parameters, _uncertainties(tests, best, predicted), predicted)


def _own(table: Table, name: str, rows: np.ndarray) -> Array:
    """Numbers `(n,)` of a column that is filled only in the given rows; 0 in the others."""
    found = np.zeros(len(rows))
    if not rows.any():
        return found
    table.need_columns([name], "tests of a tracker")
    cells = table.cells([name])[name]
    wrong = np.flatnonzero((cells != "") != rows)
    if len(wrong):
        table.fault(int(wrong[0]), name, "empty" if cells[wrong[0]] == "" else "is not of this test")
    for row in np.flatnonzero(rows).tolist():
        try:
            found[row] = float(cells[row])
        except ValueError:
            found[row] = np.nan
        if not np.isfinite(found[row]) or found[row] <= 0.0:
            table.fault(row, name, f"{str(cells[row])!r} is no number above 0")
    return found


def _coverage(table: Table) -> float:
    if "coverage" not in table.entries:
        raise UserError(f"{table.source}: header line '# coverage: 2' (k of the stated values) is missing")
    (k,) = table.header_numbers("coverage", 1)
    if not k > 0.0:
        table.header_fault("coverage", f"{k:g} is not above 0")
    return k


def _refuse_unidentifiable(tests: TrackerTests) -> None:
    across = np.isin(tests.kind, ["length", "two-face"])
    for rows, fault, remedy in (
        (tests.kind == "ranging", "the range", "ranging tests"),
        (across, "the angles", "length or two-face tests"),
    ):
        apart = np.unique(np.round(tests.ranges[rows].max(axis=1), 3)) if rows.any() else np.empty(0)
        if len(apart) < 2 or rows.sum() < 3:
            raise UserError(f"{tests.source}: {fault}: three or more {remedy}, at two or more ranges, are needed")


def _likelihood(parameters: Array, tests: TrackerTests) -> tuple[float, Array]:
    """Negative log-likelihood of measured errors, and its derivatives."""
    variance, slopes = tests.variances(parameters), tests.slopes(parameters)
    total = 0.5 * np.sum(tests.dof * np.log(variance) + tests.value**2 / variance)
    return float(total), 0.5 * (tests.dof / variance - (tests.value / variance) ** 2) @ slopes


def _logarithms(parameters: Array, tests: TrackerTests) -> tuple[float, Array]:
    """Sum of squares of logarithms of stated over predicted values, and its derivatives."""
    assert tests.coverage is not None
    variance, slopes = tests.variances(parameters), tests.slopes(parameters)
    left = 0.5 * np.log(variance * tests.dof) - np.log(tests.value / tests.coverage)
    return float(left @ left), (left / variance) @ slopes


def _uncertainties(tests: TrackerTests, parameters: Array, predicted: Array) -> Array:
    """Standard uncertainties `(4,)` from Fisher's information; for stated values from the scatter about the fit."""
    relative = tests.slopes(parameters) / tests.variances(parameters)[:, None]
    if tests.coverage is None:
        information = 0.5 * (relative * tests.dof[:, None]).T @ relative
    else:
        left = np.log(predicted) - np.log(tests.value / tests.coverage)
        scatter = float(left @ left) / max(len(left) - 4, 1)
        information = 0.25 * relative.T @ relative / max(scatter, 1e-12)
    return np.asarray(np.sqrt(np.maximum(np.diag(np.linalg.pinv(information, hermitian=True)), 0.0)))
