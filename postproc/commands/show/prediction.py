"""Statistics of a prediction, accumulated block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from calibration.fit.prediction import Predicted, Prediction
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.files.number_text import plus_minus
from kinematics.files.report_head import calibration_text
from kinematics.transforms import Array
from postproc.evaluation.predicted_errors import Statistic
from rendering.figures import Figure
from rendering.report import Report, Section, Table

LISTED_POINTS = 20
"""Most points that the report lists."""
TEXT = "Actual minus nominal, tool relative to workpiece. A cone points to the side to which the tool deviates."
LARGEST = (
    f"The table has at most {LISTED_POINTS} points, with their axis positions. Deviations along x, y and z have their "
    "standard uncertainties (k=1). Rows count from 1 below the names of the columns."
)
DEMONSTRATION = "DEMONSTRATION CALIBRATION: it describes no real machine."


class Point(NamedTuple):
    """The prediction at one row."""

    size: float
    """Deviation, um."""
    row: int
    """Row below the names of the columns, from 0."""
    deviation: Array
    """Deviation `(3,)`, um."""
    u: Array
    """Standard uncertainties `(3,)`, um, k = 1."""


@dataclass
class Summary:
    """Statistics of a prediction, um, accumulated block by block."""

    count: int = 0
    significant: int = 0
    """Number of points at which a component is larger than `COVERAGE_FACTOR` times its uncertainty."""
    point: Statistic = field(default_factory=Statistic)
    point_u: Statistic = field(default_factory=Statistic)
    components: tuple[Statistic, ...] = field(default_factory=lambda: (Statistic(), Statistic(), Statistic()))
    uncertainties: tuple[Statistic, ...] = field(default_factory=lambda: (Statistic(), Statistic(), Statistic()))
    largest: list[Point] = field(default_factory=list)
    """The points with the largest deviations, the largest first."""

    def add(self, block: Predicted) -> None:
        """Add a block."""
        self.count += len(block.deviation)
        self.significant += int(np.any(np.abs(block.deviation) > COVERAGE_FACTOR * block.u, axis=1).sum())
        sizes = np.linalg.norm(block.deviation, axis=1)
        self.point.add(sizes)
        self.point_u.add(np.linalg.norm(block.u, axis=1))
        for i in range(3):
            self.components[i].add(block.deviation[:, i])
            self.uncertainties[i].add(block.u[:, i])
        for i in np.argsort(-sizes, kind="stable")[:LISTED_POINTS].tolist():
            self.largest.append(Point(float(sizes[i]), block.rows.start + i, block.deviation[i], block.u[i]))
        self.largest = sorted(self.largest, key=lambda point: (-point.size, point.row))[:LISTED_POINTS]

    def json(self) -> dict[str, Any]:
        """The statistics for programs."""
        return {
            "points": self.count,
            "deviation_um": self.point.json(),
            **{f"d{xyz}_um": statistic.json() for xyz, statistic in zip("xyz", self.components, strict=True)},
            **{f"u_d{xyz}_um": statistic.json() for xyz, statistic in zip("xyz", self.uncertainties, strict=True)},
            "significant_share": round(self.significant / self.count, 6),
            "significant_k": COVERAGE_FACTOR,
        }

    def report(self, prediction: Prediction, figure: Callable[[], Figure]) -> Report:
        """The statistics for people; `figure`: the deviations in the volume."""
        machine, model = prediction.machine, prediction.model
        sections = [
            Section("Deviations in the workpiece frame", TEXT, figure=figure),
            Section("Deviations", table=self._statistics()),
            Section("Uncertainty", str(prediction.relative())),
            Section("Largest deviations", LARGEST, self._largest(prediction), detail=True),
        ]
        head = machine.report.filled(machine=machine.name, calibration=calibration_text(model))
        lead = f"machine {machine.name} · calibration {model.id if model.effects else 'none'}"
        return Report("Prediction", lead, sections, self._verdict(demonstration=model.demonstration), head=head)

    def _verdict(self, *, demonstration: bool) -> str:
        warning = f"{DEMONSTRATION}\n" if demonstration else ""
        return (
            f"{warning}{self.count} points: deviation of the tool point {self.point.rms:.2f} um RMS, at most "
            f"{self.point.largest:.2f} um; at {self.significant} of them it is significant: a component exceeds "
            f"{COVERAGE_FACTOR:g} times its standard uncertainty."
        )

    def _statistics(self) -> Table:
        """Largest and RMS deviation with the RMS standard uncertainty."""
        named = [("tool point", self.point, self.point_u)]
        named += zip(("along x", "along y", "along z"), self.components, self.uncertainties, strict=True)
        rows = [
            (name, f"{d.largest:.2f}", f"{d.rms:.2f}", f"{u.rms:.2f}" if u.largest else "not known")
            for name, d, u in named
        ]
        return Table(("deviation, um", "max", "RMS", "standard uncertainty (k=1), RMS"), rows)

    def _largest(self, prediction: Prediction) -> Table:
        """The points with the largest deviations, with their axis positions."""
        machine = prediction.machine
        positions = prediction.state.positions[[point.row for point in self.largest]] / machine.scale
        rows = [
            (
                str(point.row + 1),
                *(f"{at:.3f}" for at in position),
                *(plus_minus(d, u, 2) for d, u in zip(point.deviation, point.u, strict=True)),
                f"{point.size:.2f}",
            )
            for point, position in zip(self.largest, positions, strict=True)
        ]
        axes = (f"{axis.name}, {axis.unit}" for axis in machine.axes)
        return Table(("row", *axes, "dx, um", "dy, um", "dz, um", "size, um"), rows)
