"""Statistics of a prediction, accumulated block by block."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calibration.fit.prediction import Predicted
from postproc.compensation.significance import COVERAGE
from postproc.correct.result import Statistic


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
