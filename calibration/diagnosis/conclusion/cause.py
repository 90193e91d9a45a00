"""A cause that the data support, with its size and what else may be there in its place."""

from __future__ import annotations

from typing import Literal, NamedTuple

from calibration.diagnosis.conclusion.verdict import Verdict
from calibration.diagnosis.contract import where
from kinematics.effects import Effect
from kinematics.transforms import Array


class Alternative(NamedTuple):
    """Another cause that these data do not tell from the named one."""

    kind: str
    axis: str | None
    name: str
    cosine: float
    """Cosine of what both would contribute to the observations."""
    odds: float
    """Odds of the named cause against this one."""


class Cause(NamedTuple):
    """A cause that the data support."""

    kind: str
    """Kind of its effect by contract 4.3: backlash, cyclic, thermal-drift, ..."""
    effect: Effect
    """With its parameters and standard uncertainties."""
    covariance: Array
    """Of its parameters `(P, P)`, in their units."""
    log_odds: float
    """Against none."""
    verdict: Verdict
    """Strong, weak, or tied with the alternatives."""
    alternatives: tuple[Alternative, ...] = ()
    """Causes that the data do not tell from it, the likeliest first."""
    heldout_gain_um: float = 0.0
    """Improvement of the prediction of held-out blocks."""
    share: float = 0.0
    """Share of the squares without any cause that follows this one."""
    present: Effect | None = None
    """Effect of the calibration that was given which it changes; None where it is a cause of its own."""

    @property
    def where(self) -> Literal["machine", "instrument"]:
        """What it is an error of."""
        return "instrument" if self.effect.ACTS_ON == "instrument" else "machine"

    @property
    def axis(self) -> str | None:
        """Axis, or direction of the tool, or circle, station or target of the instrument."""
        return where(self.effect)
