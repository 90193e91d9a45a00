"""Sentences on the whole diagnosis, all derived from one set of figures: no sentence contradicts a figure.

The residual has one of five conditions. It *depends* on variables where a smooth function of them explains it. It is
*not noise* where a test finds a pattern that no function explains, *too large* where only its size is significant, and
*untested* where too few data are left. It is *noise* only where all tests of whiteness pass.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from calibration.diagnosis.residual.whiteness import SIZE, Test
from calibration.diagnosis.verdict import Verdict
from kinematics.files.number_text import probability, rounded

Condition = Literal["depends", "not noise", "too large", "untested", "noise"]
FAR = 4.0
"""Ratio of the residual variance to the specified variance, or its inverse, above which a note is printed."""
FEW = 20.0
"""Degrees of freedom below which verdicts are not reliable."""
LISTED = 3
"""Most significant tests that a sentence lists."""
ESTIMATE = "--noise estimate takes the noise from the residuals"


@dataclass(frozen=True)
class Conclusion:
    """Figures of a diagnosis, and the sentences that they permit."""

    verdicts: tuple[Verdict, ...]
    """Verdicts of the causes."""
    significant: tuple[Test, ...]
    """Tests of the residuals with all causes that pure noise would not fail, the clearest first."""
    tested: bool
    """True where there were enough rows for the tests."""
    dependence: str
    """Size, variables and p-value of a dependence that no cause explains; empty without one."""
    added: bool
    """True where this dependence was added to the model as an unnamed effect."""
    reason: str
    """Reason against the new calibration; empty without one."""
    failed: tuple[str, ...]
    """Runs or set-ups that were not used."""
    chi2_reduced: float
    specified: bool
    """True where the noise is specified, not estimated from the residuals."""
    degrees_of_freedom: float
    model: str = "the present model"
    """Name of the model without the causes."""
    undecided: bool = False
    """True where noise larger than specified was estimated, and too few visits show whether it is noise."""
    unit: str = "um"
    """Unit of the residuals."""
    between: tuple[str, ...] = ()
    """Clauses on the axes whose errors are uncertain between their measured positions."""
    at_an_end: bool = False
    """True where the outliers lie at one end and are off alike, as after a knock."""

    @property
    def condition(self) -> Condition:
        """Condition of the residual with all causes."""
        if self.dependence:
            return "depends"
        if any(test.name != SIZE for test in self.significant):
            return "not noise"
        if self.significant:
            return "too large"
        return "noise" if self.tested and self.degrees_of_freedom >= FEW else "untested"

    def missing(self, named: str, improvement: str) -> str:
        """Sentences on the causes, in words `named`, and on the residual; `improvement`: the figures before and after.

        `named` is empty without causes.
        """
        if named:
            them = "it" if len(self.verdicts) == 1 else "them"
            text = f"Missing in the present model: {named}. With {them}: {improvement}."
            return " ".join([text, *self._still(), *self._not_used()])
        return " ".join([f"{improvement[0].upper()}{improvement[1:]}. {self._without_causes()}.", *self._not_used()])

    def _still(self) -> Iterator[str]:
        """Sentence on the residual beside named causes; none for noise."""
        if self.added:
            yield "An unnamed effect is not a cause: no cause of the library explains the dependence."
        elif self.condition == "depends":
            yield "Something else is missing that no cause of the library explains."
        elif self.condition == "not noise":
            yield f"Something else is missing: the residuals are not noise ({self._failing})."
        elif self.condition == "too large":
            yield f"The residuals are still larger than the specified noise ({self._failing})."
        elif self.condition == "untested":
            yield f"Too few data are left for a test of the residuals ({self._freedom})."

    def _without_causes(self) -> str:
        """The first clause of a diagnosis without causes."""
        if self.condition == "depends":
            return "Something is missing that no cause of the library explains"
        if self.condition == "not noise":
            return (
                f"Something is missing: the residuals are not noise ({self._failing}), and no cause of the library "
                "explains them"
            )
        if self.condition == "too large":
            return f"No cause was found, but the residuals are larger than the specified noise ({self._failing})"
        if self.condition == "untested":
            return f"No cause was found, but too few data are left for a test of the residuals ({self._freedom})"
        if self.undecided:
            return (
                "No cause was found. The residuals look like noise, but they are larger than specified, and too few "
                "positions were measured again to tell noise from errors that the model lacks"
            )
        used = " that were used" if self.failed else ""
        start = "No missing cause was found" if self.failed else "Nothing is missing that these data can show"
        return f"{start}: {self.model} explains the data{used} down to their noise"

    def _not_used(self) -> Iterator[str]:
        if self.failed:
            yield f"NOT USED: {', '.join(self.failed)}; this diagnosis does not apply to them."

    def residual(self, rms_um: float, noise_um: float) -> str:
        """Size and property of the residual; the ratio to the noise only where the residual may be noise."""
        size = f"{rms_um:.2f} {self.unit} RMS"
        if self.condition == "depends":
            return (
                f"{size}; {self.dependence}{'; this dependence was added as an unnamed effect' if self.added else ''}"
            )
        if self.condition == "not noise":
            return f"{size}; it is not noise, and no function of the recorded variables explains it"
        size = f"{size}, {rms_um / max(noise_um, 1e-12):.2f} times the noise"
        if self.condition == "too large":
            return f"{size}; it is larger than the specified noise"
        if self.condition == "untested":
            return f"{size}; too few data are left for a test of it"
        return f"{size}; it depends on no recorded variable"

    @property
    def unexplained(self) -> str:
        """Sentences on a residual for which no function of known variables was found."""
        if self.condition == "not noise":
            return (
                f"The remaining residuals are not noise ({self._failing}), but no smooth function of the recorded "
                "variables explains them: they vary with something that is not recorded, or faster than the rows."
            )
        if self.condition == "too large":
            return (
                f"The remaining residuals are larger than the specified noise ({self._failing}). The other tests find "
                "no pattern: the specification is too small, or the machine does not repeat better."
            )
        if self.condition == "untested":
            return f"The remaining residuals were not tested: too few data are left ({self._freedom})."
        return "The remaining residuals show no dependence on any recorded variable."

    @property
    def advice(self) -> str:
        """The next step where no measurement is proposed."""
        return next(self._steps())

    def _steps(self) -> Iterator[str]:
        """Next steps, the most important first."""
        if self.condition == "depends":
            yield (
                "Measure the same positions again in another order: a dependence that recurs with the position "
                "belongs to the machine."
            )
        if self.condition == "not noise":
            yield (
                "Measure the same positions again: a deviation that recurs belongs to the machine. Record temperatures "
                "and times: the residuals vary with something that the data do not hold."
            )
        if self.failed:
            yield f"Find out why {', '.join(self.failed)} disagree with the other rows, and measure them again."
        if self.condition == "untested":
            yield f"Measure more positions: {self._freedom} are too few for a test of the residuals."
        if self.reason:
            yield "There is a reason against the new calibration: follow the advice beside it, at the head."
        if self.condition == "too large":
            yield (
                "Measure some positions again several times: this shows whether the instrument is noisier than "
                f"specified, or the machine does not repeat. {ESTIMATE[0].upper()}{ESTIMATE[1:]}."
            )
        if self.at_an_end:
            yield "Measure some of the other positions again: after a knock, or if a target was moved, all are off."
        if "tied" in self.verdicts:
            yield "No measurement that can be planned from these data separates the tied causes."
        if "weak" in self.verdicts:
            yield "Measure the same positions again: the data confirm a weak cause, or it disappears."
        needless = "no cause is weak or tied, and the residuals depend on no recorded variable"
        if self.between:
            yield f"Causes need no further measurement: {needless}. But {'; '.join(self.between)}."
        else:
            yield f"No further measurement is needed: {needless}."

    @property
    def notes(self) -> Iterator[str]:
        """Weaknesses of the result."""
        if self.degrees_of_freedom < FEW:
            yield f"Too few data for reliable verdicts: {self._freedom}."
        elif self.specified and self.chi2_reduced < 1 / FAR:
            yield f"chi2/dof {rounded(self.chi2_reduced)}: the specified noise is too large; {ESTIMATE}."
        elif self.specified and self.chi2_reduced > FAR:
            pattern = self.condition in ("depends", "not noise")
            other = "the model is incomplete" if pattern else "the machine does not repeat"
            yield f"chi2/dof {rounded(self.chi2_reduced)}: {other}, or the specified noise is too small; {ESTIMATE}."

    @property
    def _failing(self) -> str:
        listed = [f"{test.name}: {probability(test.p_value)}" for test in self.significant[:LISTED]]
        return "; ".join(listed)

    @property
    def _freedom(self) -> str:
        return f"{self.degrees_of_freedom:.0f} degrees of freedom"
