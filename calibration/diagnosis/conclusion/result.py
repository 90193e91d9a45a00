"""The answer of a search among structures: verdicts, sizes, the calibration, and whether it may be used."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.conclusion.cause import Alternative, Cause
from calibration.diagnosis.conclusion.change import change_since, size_in
from calibration.diagnosis.conclusion.design import Designed, designed
from calibration.diagnosis.conclusion.fitted_rows import covariance
from calibration.diagnosis.conclusion.functions import obstacle
from calibration.diagnosis.conclusion.guard import HeldOut, held_out, in_units, rms_um
from calibration.diagnosis.conclusion.mixture import (
    UNDECIDED,
    InPlace,
    Mixture,
    Parameters,
    averaged,
    likely_structures,
)
from calibration.diagnosis.conclusion.verdict import Judged, judged
from calibration.diagnosis.conclusion.visibility import Expected, expected, shortest_periods, unseen_motions
from calibration.diagnosis.conclusion.volume import Volume, volume
from calibration.diagnosis.conclusion.worse_than_none import AsGiven, as_given
from calibration.diagnosis.contract import where
from calibration.diagnosis.named import untested
from calibration.diagnosis.nameless import of_next_stop
from calibration.diagnosis.next.proposals import CHECK, ProposedMeasurement, proposed
from calibration.evaluation.machine_change import MachineChange
from calibration.fit.acceptance import Judged as Accepted
from calibration.fit.acceptance import significant_share
from calibration.fit.calibrate import provenance
from calibration.fit.prediction import relative_deviations
from calibration.fit.written.calibrated import machine_model, prior_sizes
from calibration.fit.written.next_stop import with_next_stop
from calibration.gaussian_terms.outliers import log_odds, shifts
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Structure
from calibration.gaussian_terms.term import Term
from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from kinematics.effects import Outliers
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.files.number_text import rounded
from kinematics.transforms import Array
from rendering.shown import Shown

POINT_COMPONENTS = 3
"""Components of an observed point."""
FINE = "fine"
"""Kind of terms that are the fine structure of an error motion: no cause, and nothing unexplained."""


class Figures(NamedTuple):
    """Residuals of a structure."""

    rms_um: float
    """RMS per scalar."""
    max_um: float
    """Largest length of the residual of a row."""
    chi2_reduced: float
    """chi2 by the instrument specification, per degree of freedom."""
    heldout_rms_um: float
    """RMS per scalar of held-out blocks, predicted from the others."""


@dataclass(frozen=True, repr=False)
class Diagnosis(Accepted, Shown):
    """The answer of a search."""

    candidates: Candidates
    """The structure found, and the odds of all terms beside it."""
    judged: tuple[Judged, ...]
    """Its terms, with the evidence for each."""
    findings: tuple[Finding, ...]
    """Anomalies of the data."""
    forced: bool
    """True where the calibration is written although it predicts worse than none."""
    add_unexplained: bool
    """True where the calibration corrects functions without a name too, as far as it can."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        before, after = self.figures
        causes = ", ".join(cause.effect.name for cause in self.causes) or "no cause found"
        return f"{self.measurement.machine.name}, {before.rms_um:.3g} -> {after.rms_um:.3g} um RMS: {causes}"

    @property
    def structure(self) -> Structure:
        """The structure found."""
        return self.candidates.structure

    @property
    def measurement(self) -> Measurement:
        """The measurement."""
        return self.structure.data.observations.measurement

    @property
    def given(self) -> ErrorModel | None:
        """The calibration that was given, over the ranges of the measurement; None without one."""
        return self.structure.data.observations.given

    @property
    def confirmed(self) -> bool:
        """True where the measurement shows no change of the machine since the calibration that was given."""
        changed = self.unexplained or any(_of_machine(cause) for cause in self.causes)
        return self.given is not None and self.accepted and not changed

    @cached_property
    def held_out(self) -> HeldOut:
        """Held-out blocks, predicted from the others."""
        return held_out(self.structure)

    @cached_property
    def bare(self) -> Structure:
        """The structure without terms, with the noise that was found."""
        return self.structure.with_terms(()).with_sizes()

    @property
    def objection(self) -> str:  # type: ignore[override]
        """Reason against the calibration; empty without one."""
        held = self.held_out
        if not held.worse:
            return ""
        other = "no model" if self.given is None else "the calibration that was given"
        return (
            f"the result predicts held-out blocks of rows worse ({rounded(held.with_all, 3)} um RMS) than {other} "
            f"does ({rounded(held.nothing, 3)} um): check the data, or measure more"
        )

    @property
    def noise_um(self) -> float:
        """RMS, um per scalar, that residuals of pure noise would have."""
        observations = self.structure.data.observations
        squares = np.trace(covariance(self.structure), axis1=1, axis2=2)
        micro = observations.measurement.per_micro[:, 0]
        return float(np.sqrt(np.mean(squares * micro**2) / observations.components))

    @property
    def rank(self) -> int:
        """Number of directions of the coefficients that the data determine better than their prior."""
        sizes = self.structure.sizes
        gram = self.structure.equations.gram * sizes[:, None] * sizes
        return int(np.count_nonzero(np.linalg.eigvalsh(gram) > self.structure.noise.factor))

    @property
    def outliers(self) -> list[int]:
        """Rows that are left out."""
        return np.flatnonzero(self.structure.noise.left_out).tolist()

    @cached_property
    def sizes(self) -> Mixture:
        """What is known of the terms of the structure alone."""
        return Mixture.of(self.structure)

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Causes with their sizes, the likeliest first."""
        found = [self._cause(each) for each in self.judged if each.term.named and not each.periods]
        outliers = self._outliers()
        return tuple(sorted([*found, *outliers], key=lambda cause: -cause.log_odds))

    @cached_property
    def _places(self) -> list[InPlace]:
        """What may be there in the place of each term."""
        return [InPlace.of(self.structure, each) for each in self.judged]

    @property
    def unexplained(self) -> tuple[Judged, ...]:
        """Functions without a name, and waves whose period is open."""
        return tuple(each for each in self.judged if each.periods or not (each.term.named or each.term.kind == FINE))

    def rms_of(self, some: Sequence[Judged]) -> float:
        """RMS, um per scalar, of what some terms contribute to the observations."""
        columns = np.concatenate([np.zeros(0, int), *(self.structure.columns_of(each.number) for each in some)])
        return rms_um(self.structure, self.structure.explained(columns))

    def contribution(self, each: Judged) -> Array:
        """What a term contributes to the observations `(n, d)`, mm and rad."""
        return np.asarray(each.term.columns @ self.structure.posterior.mean[self.structure.columns_of(each.number)])

    @property
    def not_repeating(self) -> dict[str, float]:
        """Standard deviation of each axis from stop to stop, um or urad, where the data show it clearly."""
        return self.structure.not_repeating

    @property
    def added(self) -> tuple[Judged, ...]:
        """Functions without a name that the calibration corrects."""
        asked = self.unexplained if self.add_unexplained else ()
        return tuple(each for each in asked if not obstacle(each, self.held_out))

    @cached_property
    def expected(self) -> list[Expected]:
        """The causes that were tried and are not present, as the data would show them."""
        return expected(self.candidates)

    @cached_property
    def unseen_motions(self) -> list[str]:
        """Names of the error motions that the data do not show."""
        return list(dict.fromkeys(unseen_motions(self.structure)))

    @property
    def not_visible(self) -> list[str]:
        """Names of error motions and causes that the data do not show."""
        hidden = [each.effect.name for each in self.expected if not each.visible]
        encoders = [f"sub-divisional error of the encoder of {axis}" for axis in self.shortest_periods]
        return list(dict.fromkeys([*self.unseen_motions, *hidden, *encoders]))

    @property
    def shortest_periods(self) -> dict[str, float]:
        """Of each linear axis whose encoder may have errors that are not sought: the shortest period that is, mm."""
        return shortest_periods(self.measurement)

    @property
    def untested(self) -> list[tuple[str, str]]:
        """Names of the causes that could not be tried, and the columns that the data lack for them."""
        return untested(self.measurement)

    @property
    def next_measurement(self) -> str:
        """Recommended next measurement, as text for the workshop."""
        return self.proposals[0].text if self.proposals else CHECK

    @property
    def model(self) -> ErrorModel:
        """The calibration."""
        return self.calibration

    @cached_property
    def as_given(self) -> AsGiven | None:
        """The calibration as it was given, compared with no correction; None without one."""
        return as_given(self.structure)

    @cached_property
    def volume(self) -> Volume:
        """Errors of the machine over the measured states, by the calibration."""
        present = no_errors(self.measurement.machine) if self.given is None else self.given
        return volume(self.measurement, self.calibration, present)

    @cached_property
    def significant_share(self) -> float:
        """Share of the measured states at which the correction exceeds twice its standard uncertainty."""
        return significant_share(relative_deviations(self.calibration, self.measurement))

    @cached_property
    def unexplained_share(self) -> float:
        """Share of the squares without any cause that no term follows."""
        return self._part(self.structure.left)

    @cached_property
    def figures(self) -> tuple[Figures, Figures]:
        """Residuals without and with the terms."""
        return _figures(self.bare, self.held_out.geometry), _figures(self.structure, self.held_out.with_all)

    @cached_property
    def design(self) -> list[Designed]:
        """The causes that the rows can show and separate, whatever is read."""
        return designed(self.structure.data, self.candidates.dictionary)

    @cached_property
    def proposals(self) -> tuple[ProposedMeasurement, ...]:
        """Measurements that answer what the data leave open, the best first; then questions that none answers."""
        functions = [each for each in self.unexplained if not each.term.named]
        return tuple(proposed(self.candidates, self.judged, self._places, functions))

    @cached_property
    def _averaged(self) -> Parameters:
        """Parameters of the geometry and of the terms, over all that the data leave undecided."""
        structures = likely_structures(self.structure, self.judged, self._places)
        known = {term.family for one in structures for term in one.structure.terms}
        return averaged(structures, self._undecided(known), [each.term for each in self.added])

    @cached_property
    def calibration(self) -> ErrorModel:
        """The calibration, over all that the data leave undecided."""
        found = self._averaged
        prior, own = np.ones(len(found.values)), prior_sizes(self.structure)
        prior[: len(own)] = own
        model = machine_model(self.measurement, found.effects, found.values, found.covariance, prior, self.given)
        model = with_next_stop(model, of_next_stop(self.structure, self.not_repeating))
        effects = tuple(effect.lasting() for effect in model.effects)
        names = [f"{cause.kind} {where(cause.effect) or ''}".strip() for cause in self.causes if _of_machine(cause)]
        added = f"; added: {', '.join(names)}" if names else ""
        observations = f"diagnosis of {self.structure.whitener.observed} observations{added}"
        made = provenance([self.measurement], effects, observations, None)
        if self.given is not None:
            made = msgspec.structs.replace(made, inputs={**self.given.provenance.inputs, **made.inputs})
        return msgspec.structs.replace(model, effects=effects, provenance=made)

    @cached_property
    def machine_change(self) -> MachineChange | None:
        """Change of the machine since the calibration that was given; None without one."""
        return change_since(self.structure, self._averaged)

    def _undecided(self, known: Collection[Hashable]) -> list[tuple[Term, float]]:
        """Causes of other families that the data neither name nor exclude, with their log odds."""
        families = self.candidates.by_family(self.candidates.odds())
        likely = ((self.candidates.terms[best], odds) for odds, best in families.values() if odds > UNDECIDED)
        return [(term, odds) for term, odds in likely if term.named and term.family not in known]

    def _cause(self, each: Judged) -> Cause:
        """A term as a cause, with its size."""
        term, place = each.term, self._places[each.number]
        cosines = dict(zip(place.terms, place.cosines, strict=True))
        others = tuple(
            Alternative(one.term.kind, one.term.where, one.term.name, cosines[one.term], float(np.exp(one.log_odds)))
            for one in each.alternatives
        )
        gain = self.held_out.without[each.number] - self.held_out.with_all
        found = self.sizes.effect_of(each.term)
        (effect,) = found.sized()
        return Cause(
            term.kind,
            effect,
            found.covariance,
            each.log_odds,
            each.verdict,
            others,
            gain,
            self._share(each),
            size_in(self.given, effect),
        )

    def _share(self, each: Judged) -> float:
        """Share of the squares without any cause that follows a term; the shares of all terms and the rest are 1."""
        columns = self.structure.columns_of(each.number)
        return self._part(self.structure.explained(columns))

    def _part(self, values: Array) -> float:
        """Share of the squares without any cause that follows values `(N,)`."""
        whole = self.bare.left
        return min(max(float(values @ whole) / max(float(whole @ whole), np.finfo(float).tiny), 0.0), 1.0)

    def _outliers(self) -> list[Cause]:
        """The outliers of points as one cause.

        None beside a function without a name, which makes some where it is too coarse.
        """
        rows = np.array(self.outliers, int)
        nameless = any(not (each.term.named or each.term.kind == FINE) for each in self.judged)
        odds = float(log_odds(self.structure)[rows].sum()) if len(rows) else 0.0
        if nameless or odds < CLEAR_LOG_ODDS or self.measurement.instrument.components != POINT_COMPONENTS:
            return []
        shift, covariance = shifts(self.structure, rows)
        u = 1e3 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).ravel()
        effect = Outliers(
            rows=tuple(rows.tolist()), shift_um=tuple((1e3 * shift).ravel().tolist()), u=tuple(u.tolist())
        )
        return [Cause("outliers", effect, np.diag(u**2), odds, "strong")]


def answered(
    candidates: Candidates, findings: Sequence[Finding] = (), *, force: bool = False, add_unexplained: bool = False
) -> Diagnosis:
    """The answer by the structure that a search has found, and the odds of all terms beside it."""
    return Diagnosis(candidates, tuple(judged(candidates)), tuple(findings), force, add_unexplained)


def _of_machine(cause: Cause) -> bool:
    return cause.effect.ACTS_ON != "instrument"


def _figures(structure: Structure, heldout_rms_um: float) -> Figures:
    """Residuals of a structure."""
    observations, residual = structure.data.observations, in_units(structure, structure.left)
    inside = ~structure.noise.left_out
    micro = (residual * observations.measurement.per_micro)[inside]
    white = np.linalg.solve(np.linalg.cholesky(observations.specified[inside]), residual[inside][:, :, None])
    determined = float(structure.posterior.determined.sum())
    freedom = max(structure.whitener.scalars - determined, 1.0)
    return Figures(
        float(np.sqrt(np.mean(micro**2))),
        float(np.linalg.norm(micro, axis=1).max()),
        float(np.sum(white**2)) / freedom,
        heldout_rms_um,
    )
