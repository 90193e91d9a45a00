"""Verdicts of causes: ties, and notes on sizes with an unusual sign."""

from dataclasses import replace

import numpy as np
import pytest
from calibration.diagnosis.library.candidate import Candidate
from calibration.diagnosis.search.evaluation import Evaluated, Sibling
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.search.score import Projected, Score
from calibration.diagnosis.search.stage import Accepted
from calibration.diagnosis.verdict import notes, outliers, tied_with, verdict_of
from support.diagnosis_cases import CFRAME, data_with, fitted, framed

from calibration.observation.equations import specified_covariance
from calibration.observation.normal_equations import whitened, whiteners
from calibration.reports.causes.text import sizes
from kinematics.effects import Backlash, CrossAxis, Cyclic, Settling, UnknownApproach

SCORE = Score(500.0, 500.0, 1.0, -480.0, 1e-9, np.ones(1))
PROJECTED = Projected(np.ones((3, 1)), np.zeros((2, 1)), np.ones((1, 1)))


def bent(component, other):
    return CrossAxis(component, "X", other, (0.0, 500.0), (0.0, 400.0), 0, 1, (0.0,))


def wave(component):
    return Cyclic("X", component, 20.0, (0.0,), (0.0,))


def accepted(effect, *others):
    """A cause that predicts every held-out block better, with siblings `(effect, cosine, log odds)`."""
    siblings = tuple(Sibling(Evaluated(Candidate(other), PROJECTED, SCORE), *figures) for other, *figures in others)
    gains = np.array([9.0, 10.0, 11.0, 10.0])
    return Accepted(Candidate(effect), np.ones(1), SCORE, 0.9, lambda: gains, siblings)


@pytest.mark.parametrize(
    ("own", "other"),
    [
        (wave("Y"), wave("Z")),
        (bent("Y", "Z"), bent("Y", "Y")),
        (bent("Y", "Z"), bent("C", "Z")),
        (Backlash("X", 1.0), Settling(axis="X", share_ppm=1.0)),
    ],
)
def test_a_tie_counts_also_within_one_axis_and_kind(own, other):
    cause = accepted(own, (other, 1.0, 0.3))
    assert [sibling.evaluated.candidate.effect for sibling in tied_with(cause)] == [other]
    assert verdict_of(cause) == "tied"


@pytest.mark.parametrize("cosine", [0.75, 0.9, 1.0])
def test_odds_decide_on_a_tie_however_alike_the_siblings_are(cosine):
    assert verdict_of(accepted(wave("Y"), (wave("Z"), cosine, 4.9))) == "tied"
    less_likely = accepted(wave("Y"), (wave("Z"), cosine, 5.1))
    assert not tied_with(less_likely)
    assert verdict_of(less_likely) == "strong"


@pytest.mark.parametrize(
    ("gains", "verdict"),
    [
        ([316.0, 113.5, 40.5, 3.1, 35.9, 8.8, 21.3, 14.1], "strong"),
        ([316.0, 113.5, 40.5, -3.1, 35.9, 8.8, 21.3, 14.1], "weak"),
        ([316.0, 40.5, 3.1, 8.8, 14.1], "weak"),
    ],
)
def test_a_gain_in_every_one_of_enough_blocks_is_clear_however_uneven(gains, verdict):
    assert verdict_of(replace(accepted(wave("Y")), held_out=lambda: np.array(gains))) == verdict


def test_a_negative_size_is_explained():
    linearised = framed(n=60)
    (over,) = notes(linearised, Backlash("X", -12.3))
    assert "probably larger than the real backlash by 12 um" in over
    assert "check" in over
    (early,) = notes(linearised, Settling(axis="X", share_ppm=-31.0))
    assert "31 ppm" in early
    assert "overshoots" in early
    assert "reading came early" in early
    assert not list(notes(linearised, Backlash("X", 12.3)))
    assert not list(notes(linearised, Settling(axis="X", share_ppm=31.0)))


@pytest.mark.parametrize("wrong", [(), (40,)])
def test_a_row_before_the_first_move_of_an_axis_with_backlash_is_no_outlier(wrong):
    """The axis stood on the other side of its lost motion; another row that is as far off is one."""
    data = data_with(Backlash("X", 300.0))
    along = fitted(data).registration.rotations(data)[:, :, 0] * 0.15
    observed = data.observed.copy()
    observed[[0, *wrong]] += along[[0, *wrong]]
    moved = replace(data, observed=observed, state=replace(data.state, observed=observed))
    found = fitted(moved, Backlash("X", 0.0))
    assert found.outliers.tolist() == [0, *wrong]
    cause = outliers(found, LinearisedFit.of(found))
    assert (cause.effect.rows if cause else ()) == wrong


@pytest.mark.parametrize(("known", "named_rows"), [((), ()), ((UnknownApproach("X", 0.0),), (5,))])
def test_a_wrong_row_before_the_first_move_is_an_outlier_where_the_side_is_a_parameter(known, named_rows):
    """All rows before the first move of an axis share its side: beside their own error a single one can be wrong."""
    data = data_with()
    observed, approach = data.observed.copy(), data.state.approach.copy()
    observed[5] += fitted(data).registration.rotations(data)[5, :, 1] * 0.4
    approach[:30, CFRAME.index("X")] = 0.0
    shifted = replace(data, observed=observed, state=replace(data.state, observed=observed, approach=approach))
    found = fitted(shifted, Backlash("X", 0.0), *known)
    assert 5 in found.outliers
    cause = outliers(found, LinearisedFit.of(found))
    assert (cause.effect.rows if cause else ()) == named_rows


def test_an_outlier_across_the_beam_is_one_error_of_the_tracker():
    """Its x and y are parts of one angle: counted each by its own uncertainty they would be two."""
    data = data_with()
    unit = np.linalg.cholesky(specified_covariance(data)[40])[:, 0]
    observed = data.observed.copy()
    observed[40] += 12.0 * unit
    shifted = replace(data, observed=observed, state=replace(data.state, observed=observed))
    found = fitted(shifted)
    cause = outliers(found, LinearisedFit.of(found))
    assert cause.effect.rows == (40,)
    assert sizes(cause) == ["1 row"]
    white = whitened(whiteners(shifted), found.residual)[40]
    assert cause.delta_bic == pytest.approx(3.0 * np.log(found.observations) - white @ white)
