"""Log odds of candidates are the rises of the evidence that structures with them have."""

import numpy as np
import pytest
from support.diagnosis_cases import data_with

from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.dictionary import Dictionary
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from calibration.gaussian_terms.term import Term
from kinematics.effects import AngleHarmonic, Backlash, Effect, TrackerDrift
from kinematics.error_model.priors import SIZES_IN_TYPICAL


def term_of(observations: Observations, effect: Effect) -> Term:
    typical = np.where(np.isfinite(effect.typical), effect.typical, 50.0)
    return Term(
        effect.name,
        effect.kind,
        effect.name,
        lambda: observations.columns([effect]) * typical,
        len(typical),
        (effect,),
        np.diag(typical),
    )


@pytest.fixture(scope="module")
def candidates() -> Candidates:
    observations = Observations.of(data_with(Backlash("X", 15.0), n=60))
    effects = [Backlash(axis="Y", width=0.0), TrackerDrift(), AngleHarmonic("azimuth", 1, 0.0, 0.0)]
    offered = [term_of(observations, effect) for effect in effects]
    there = [term_of(observations, effect) for effect in (Backlash(axis="X", width=0.0), Backlash(axis="Z", width=0.0))]
    structure = Structure.first(Data.of(observations)).with_terms(there).fitted()
    return Candidates.of(structure, Dictionary(offered))


def rise(structure: Structure, term: Term) -> float:
    """Log evidence that a term adds, its sizes equally likely."""
    beside = structure.with_terms((*structure.terms, term))
    each = [
        beside.resized(np.concatenate([structure.band_sizes, structure.term_sizes, [size]]))
        for size in SIZES_IN_TYPICAL
    ]
    return float(
        np.logaddexp.reduce([one.log_evidence for one in each]) - np.log(len(SIZES_IN_TYPICAL)) - structure.log_evidence
    )


@pytest.mark.parametrize("without", [(), (0,), (1,), (0, 1)])
def test_odds_are_rises_of_the_evidence(candidates, without):
    structure = candidates.structure
    kept = [i for i in range(len(structure.terms)) if i not in without]
    rest = structure.with_terms([structure.terms[i] for i in kept])
    expected = [rise(rest, term) for term in candidates.terms]
    assert candidates.odds(without) == pytest.approx(expected, rel=5e-3, abs=0.05)
    assert candidates.exact(candidates.terms, without) == pytest.approx(expected, rel=2e-3, abs=0.02)


def test_odds_beside_other_terms(candidates):
    structure = candidates.structure
    beside = (structure.terms[0], candidates.terms[1])
    assert candidates.beside(beside).exact([candidates.terms[0]])[0] == pytest.approx(
        rise(structure.with_terms(beside), candidates.terms[0]), rel=2e-3, abs=0.02
    )
