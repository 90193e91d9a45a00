"""Result of a diagnosis: the data, the fits before and after, the causes and the new calibration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.diagnosis.acceptance import Acceptance
from calibration.diagnosis.conclusion import Conclusion
from calibration.diagnosis.improvement import Figures, by_direction, figures, held_out_rows
from calibration.diagnosis.next.ranking import ProposedMeasurement
from calibration.diagnosis.not_visible import NotVisible, smallest_sizes
from calibration.diagnosis.repeatability import Repeats
from calibration.diagnosis.residual import unexplained as unexplained_residual
from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.distance_correlation import Dependence
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.search.candidates import Untested
from calibration.diagnosis.search.evaluation import Evaluated
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.stage import Stage
from calibration.diagnosis.search.start_model import Base
from calibration.diagnosis.separability import Separability
from calibration.diagnosis.terms.conclusion.volume import Volume
from calibration.diagnosis.unseen.swing import FoundSwing
from calibration.diagnosis.verdict import Named
from calibration.evaluation.machine_change import MachineChange
from calibration.fit.acceptance import relative_deviations, significant_share
from calibration.fit.curves.between_positions import BetweenPositions
from calibration.fit.identifiability import Identifiability
from calibration.measurement.estimated_noise import EstimatedNoise
from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.files.number_text import amount, probability
from rendering.shown import Shown

LEFT = 0.01
"""Chance that residuals of pure noise are found to depend on something."""


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """Result of a diagnosis: the data, the fits before and after, the causes and the new calibration."""

    measurement: Measurement
    """The measurement."""
    base: Base
    """The model at the beginning."""
    before: Stage
    """Fit of the present model; of a calibration of other data as it is."""
    named: Stage
    """Fit with the causes found, errors that the model lacks no part of its noise."""
    after: Stage
    """Fit with unnamed effects too, where these were requested and predict better; otherwise `named`."""
    model: ErrorModel
    """The new calibration: the machine's effects, without the instrument's; the present one where it is confirmed."""
    findings: tuple[Finding, ...]
    """Anomalies of the data."""
    repeats: Repeats | None
    """Scatter of rows that were measured again; None without such rows."""
    tests: tuple[Test, ...]
    """Whiteness tests of the residuals of the present model."""
    tests_after: tuple[Test, ...]
    """Whiteness tests of the residuals with the causes."""
    causes: tuple[Named, ...]
    """Causes that the data support, with sizes, um or their own unit, and standard uncertainties."""
    finer: tuple[Effect, ...]
    """Error motions whose bases the search has refined beyond those of their axes."""
    unexplained_share: float
    """Squares of the residuals with all causes, as a share of those without any; reference as of the causes' shares."""
    not_visible: tuple[NotVisible, ...]
    """Errors that the data do not show, by name."""
    untested: tuple[Untested, ...]
    """Causes that the data cannot show, with the reason."""
    identifiability: Identifiability | None
    """Identifiability of the error motions; None where a calibration of other data is the prior knowledge."""
    unexplained: Unexplained | None
    """Dependence that no cause explains, also where unnamed effects were added for it."""
    widened: float
    """Factor on the standard uncertainties of the new calibration because of this dependence; 1 without one."""
    beside_function: bool
    """True where the new calibration is that beside a function of its variables, which is no error that it can hold."""
    noise_um: float
    """RMS, um per scalar (rotary axes: urad), that residuals of pure noise would have, as of `noise_um`."""
    estimated_noise: EstimatedNoise | None
    """Noise as the residuals show it; None where they agree with its specification.

    Beside a swing or a course in time that no cause explains it is the noise that these leave.
    """
    swing: FoundSwing | None
    """The swing with time that this dependence is; None where it is none of one period."""
    unnamed: str
    """Result of the request to add unnamed effects; empty without a request, or with nothing to add."""
    evaluated: tuple[Evaluated, ...]
    """All candidates, evaluated on the linearised fit of the result, the best first."""
    closure: float | None
    """Share of the residual beyond the noise that no rigid chain can explain; None where the data are too few."""
    volume: Volume
    """Errors of the machine over its volume, um."""
    proposed_measurements: tuple[ProposedMeasurement, ...]
    """Proposed measurements: first for an unexplained dependence, then by predicted information per minute."""
    acceptance: Acceptance
    """Comparison with no correction and with the present model on held-out blocks."""
    design: tuple[Separability, ...]
    """Causes that the design of these data can show and separate, without the readings."""
    between_positions: tuple[BetweenPositions, ...]
    """Uncertainty between the positions of each axis that was measured at few."""
    machine_change: MachineChange | None
    """Change of the machine since its present calibration; None without one of other data."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        causes = ", ".join(cause.effect.name for cause in self.causes) or "no cause found"
        return (
            f"{self.model.machine.name}, {self.before.fit.rms_um:.3g} -> {self.after.fit.rms_um:.3g} um RMS: {causes}"
        )

    @property
    def reason(self) -> str:
        """Reason why the new calibration must not be used; empty if it may."""
        return self.acceptance.reason

    @property
    def accepted(self) -> bool:
        """True where the new calibration may be used."""
        return not self.reason

    @cached_property
    def significant_share(self) -> float:
        """Share of the measured states at which the correction exceeds twice its standard uncertainty."""
        return significant_share(relative_deviations(self.model, self.after.fit.good))

    @property
    def with_unnamed(self) -> bool:
        """True where the new model has unnamed effects."""
        return any(not each.candidate.effect.NAMES_CAUSE for each in self.after.accepted)

    @property
    def unexplained_um(self) -> float:
        """RMS, um per scalar (rotary axes: urad), of the dependence that no cause explains; 0 without one."""
        if self.unexplained is None:
            return 0.0
        return unexplained_residual.shared_rms(self.named.linearised, self.unexplained)

    def _depends_on(self, left: Unexplained) -> str:
        """`9.1 um depend on X, time (p = 0.005)`, and the period of a swing."""
        swings = "" if self.swing is None else f" and swing with a period of {self.swing.period:.4g} s"
        size = amount(self.unexplained_um, self.measurement.unit)
        return f"{size} depend on {left.listed} ({probability(left.p_value, 2)}){swings}"

    @cached_property
    def one_by_one(self) -> list[Dependence]:
        """Dependence of the residuals on each variable alone; empty where `unexplained` is None."""
        return [] if self.unexplained is None else unexplained_residual.one_by_one(self.named.linearised)

    @cached_property
    def figures(self) -> tuple[Figures, Figures]:
        """Residuals before and after, of the same rows."""
        kept, held_out = self._same_rows, held_out_rows(self.before) & held_out_rows(self.after)
        return figures(self.before, kept, held_out), figures(self.after, kept, held_out)

    @property
    def by_direction(self) -> dict[str, dict[str, float]]:
        """RMS residual, um, before and after, of the same rows, by direction (interferometer: by axis)."""
        rows = self._same_rows
        return {"before": by_direction(self.before, rows), "after": by_direction(self.after, rows)}

    @property
    def held_out_name(self) -> str:
        """Name of the held-out blocks, plural."""
        return self.after.linearised.held_out[1]

    @property
    def _same_rows(self) -> np.ndarray:
        """Mask `(n,)` of the rows that both fits kept."""
        return np.asarray(self.before.fit.kept & self.after.fit.kept)

    @property
    def smallest(self) -> list[tuple[str, float, str]]:
        """Name, size and unit of the smallest effects of one parameter that these data would show."""
        return list(smallest_sizes(self.evaluated, self.after.linearised.scalars))

    @property
    def next_measurement(self) -> str:
        """Recommended next measurement, as text for the workshop."""
        if self.proposed_measurements and self.conclusion.condition != "not noise":
            return self.proposed_measurements[0].text
        return self.conclusion.advice

    @cached_property
    def conclusion(self) -> Conclusion:
        """The figures that decide on success, and the sentences that they permit."""
        fit, left = self.after.fit, self.unexplained
        return Conclusion(
            tuple(cause.verdict for cause in self.causes),
            tuple(combined(self.tests_after, LEFT)),
            bool(self.tests_after),
            "" if left is None else self._depends_on(left),
            self.with_unnamed,
            self.acceptance.objection,
            fit.failed,
            fit.chi2_reduced,
            fit.variance_factor == 1.0,
            fit.degrees_of_freedom,
            "the present model" if self.base.present is None else "the present calibration, updated by these data,",
            fit.measurement.noise is not None and fit.measurement.noise.undecided,
            fit.measurement.unit,
            tuple(str(each) for each in self.between_positions if each.exceeds(fit.rms_um, fit.measurement.unit)),
            any(cause.kind == "outliers" and cause.verdict == "tied" for cause in self.causes),
        )


def noise_um(linearised: LinearisedFit) -> float:
    """RMS, um per scalar (rotary axes: urad), that residuals of pure noise would have."""
    spread = (
        np.linalg.inv(linearised.white)[linearised.good]
        * linearised.measurement.per_micro[linearised.rows][linearised.good, None]
    )
    return float(np.sqrt(np.sum(spread**2) / spread[:, :, 0].size))
