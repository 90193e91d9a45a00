"""Result of the evaluation of circles: the causes with their shares, and the detection limits of the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.circles.spikes import SpikeAtFeed, kept
from kinematics.transforms import Array


@dataclass(frozen=True)
class Share:
    """One cause in the result."""

    kind: str
    where: str
    parameters: Mapping[str, float]
    U: Mapping[str, float]
    """Expanded uncertainties, k = 2."""
    range_um: float
    """Range of its signal on the circles, without the part that looks like a shift or another radius."""
    share: float
    """Mean square of its signal as a share of that of all causes and of the unexplained residual."""
    log10_odds: float
    """Against none."""
    tied_with: tuple[str, ...]
    """Other causes from which the data do not tell it clearly."""
    by_feed: tuple[SpikeAtFeed, ...] = ()
    """Decay of a reversal spike at each feed, if it was measured at several."""

    @property
    def name(self) -> str:
        """Name in reports: `backlash X`."""
        return f"{self.kind} {self.where}"

    def json(self) -> dict[str, Any]:
        """The share for programs."""
        return {
            "kind": self.kind, "where": self.where, "parameters": dict(self.parameters), "U": dict(self.U),
            "range_um": self.range_um, "share": self.share, "log10_odds": self.log10_odds,
            "verdict": "tied" if self.tied_with else "clear", "tied_with": list(self.tied_with),
            **({"by_feed": [each.json() for each in self.by_feed]} if self.by_feed else {}),
            **({"keeps": kept(self.by_feed)} if self.by_feed else {}),
        }  # fmt: skip


@dataclass(frozen=True)
class Limit:
    """Detection limit of a cause that was not found: the size from which it would be."""

    name: str
    smallest: float
    """For the shape (period, distance of decay) that is identified best."""
    largest: float
    """For the shape that is seen worst."""
    unit: str

    def json(self) -> dict[str, Any]:
        """The limit for programs."""
        return {"cause": self.name, "smallest": self.smallest, "largest": self.largest, "unit": self.unit}


@dataclass(frozen=True)
class Shares:
    """The causes of the deviations, the largest share first, and the residuals with them."""

    causes: tuple[Share, ...]
    offset_um: Mapping[str, float]
    """Shift of the table ball from the stated centre in each direction that the circles show, um."""
    offset_u: Mapping[str, float]
    """Standard uncertainties of the shift, um."""
    before_um: float
    """RMS of the deviations from centre and radius, um."""
    unexplained_um: float
    """RMS of the residuals with the causes, um."""
    noise_um: float
    """Noise by the instrument's specification, um."""
    left_out: int
    """Number of rows that disagree with all others."""
    hidden: tuple[str, ...]
    """Causes whose signal centre and length imitate."""
    limits: tuple[Limit, ...]
    """Smallest sizes of the other causes that these circles would show."""
    fitted: Array
    """Signal of all causes `(n,)` at the rows used, um."""
    rows: np.ndarray
    """Numbers of the rows used."""
