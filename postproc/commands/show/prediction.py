"""Statistics of a prediction, accumulated block by block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calibration.fit.prediction import Predicted
from kinematics.files.report_head import ReportHead
from postproc.compensation.significance import COVERAGE
from postproc.evaluation.predicted_errors import Statistic
from rendering.figures import Figure
from rendering.report import Report, Section, Table


@dataclass
class Summary:
    """Statistics of a prediction, um, accumulated block by block."""

    count: int = 0
    significant: int = 0
    """Number of points at which a component is larger than COVERAGE times its uncertainty."""
    point: Statistic = field(default_factory=Statistic)
    components: tuple[Statistic, ...] = field(default_factory=lambda: (Statistic(), Statistic(), Statistic()))
    uncertainties: tuple[Statistic, ...] = field(default_factory=lambda: (Statistic(), Statistic(), Statistic()))

    def add(self, block: Predicted) -> None:
        """Add a block."""
        self.count += len(block.deviation)
        self.significant += int(np.any(np.abs(block.deviation) > COVERAGE * block.u, axis=1).sum())
        self.point.add(np.linalg.norm(block.deviation, axis=1))
        for i in range(3):
            self.components[i].add(block.deviation[:, i])
            self.uncertainties[i].add(block.u[:, i])

    def json(self) -> dict[str, Any]:
        """The statistics for programs."""
        return {
            "points": self.count,
            "deviation_um": self.point.json(),
            **{f"d{xyz}_um": statistic.json() for xyz, statistic in zip("xyz", self.components, strict=True)},
            **{f"u_d{xyz}_um": statistic.json() for xyz, statistic in zip("xyz", self.uncertainties, strict=True)},
            "significant_share": round(self.significant / self.count, 6),
            "significant_k": COVERAGE,
        }

    def report(self, uncertainty: str, figure: Callable[[], Figure], head: ReportHead) -> Report:
        """The statistics for people; `uncertainty`: that of the calibration, as text; `figure`: the deviations."""
        share = self.significant / self.count
        rows = [("tool point", f"{self.point.largest:.2f}", f"{self.point.rms:.2f}", "")]
        for xyz, d, u in zip("xyz", self.components, self.uncertainties, strict=True):
            rows.append((f"d{xyz}", f"{d.largest:.2f}", f"{d.rms:.2f}", f"{u.rms:.2f}"))
        table = Table(("um", "max", "RMS", "standard uncertainty (k=1), RMS"), rows)
        verdict = (
            f"{self.count} points: deviation of the tool point {self.point.rms:.2f} um RMS, at most "
            f"{self.point.largest:.2f} um; at {100 * share:.1f} % of them it is significant: a component exceeds "
            f"{COVERAGE:g} times its standard uncertainty."
        )
        text = "Actual minus nominal, tool relative to workpiece. A cone points to the side to which the tool deviates."
        sections = [
            Section("Deviations in the workpiece frame", text, figure=figure),
            Section("Deviation, workpiece frame", table=table),
            Section("Uncertainty", uncertainty[:1].upper() + uncertainty[1:]),
        ]
        return Report("Prediction", "", sections, verdict, head=head)
