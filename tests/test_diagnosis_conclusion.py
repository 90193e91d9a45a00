"""The sentences on a whole diagnosis: over all combinations of figures, none of them contradicts one."""

import re
from dataclasses import replace
from itertools import product

import pytest
from calibration.diagnosis.residual import whiteness
from calibration.diagnosis.residual.whiteness import SIZE

from calibration.diagnosis.conclusion import FAR, FEW, Conclusion

IN_TIME = whiteness.Test("along time", 5e-46, 0.8, "")
TOO_LARGE = whiteness.Test(SIZE, 1e-140, 9.0, "")
NOTHING = Conclusion((), (), True, "", False, "", (), 1.0, True, 400.0)
TABLE = {
    "verdicts": ((), ("strong",), ("strong", "weak"), ("tied",), ("weak", "tied")),
    "significant": ((), (IN_TIME,), (TOO_LARGE,), (TOO_LARGE, IN_TIME)),
    "tested": (True, False),
    "dependence": ("", "9.1 um depend on X, time (p = 0.005)"),
    "reason": ("", "the nominal machine predicts better"),
    "failed": ((), ("s2",)),
    "chi2_reduced": (0.1, 1.0, 9.0),
    "specified": (True, False),
    "degrees_of_freedom": (5.0, 400.0),
    "undecided": (False, True),
}
ABSENT = (
    "Nothing is missing",
    "depends on no",
    "show no dependence",
    "show no sign",
    "down to their noise",
    "No further measurement",
    "no cause is weak or tied",
    "No missing cause",
)
"""Sentences that state an absence or a success."""


def combinations():
    for values in product(*TABLE.values()):
        figures = dict(zip(TABLE, values, strict=True))
        if figures["significant"] and not figures["tested"]:
            continue  # a test that was not made
        for added in {False, bool(figures["dependence"])}:
            yield Conclusion(added=added, **figures)


def sentences(of):
    named = "; ".join(f"backlash, {verdict}" for verdict in of.verdicts)
    return [of.missing(named, "residual 9 -> 3 um RMS"), of.residual(9.0, 3.0), of.unexplained, of.advice, *of.notes]


def test_the_first_number_comes_early():
    for of in combinations():
        first = re.search(r"\d", of.missing("", "residual 9.00 um RMS, held-out lines 9.50 um"))
        assert first
        assert first.start() < 20


def test_no_further_measurement_is_not_said_beside_errors_between_the_positions():
    advice = replace(
        NOTHING, between=("between the 6 measured positions of X its errors may differ by up to 18 um",)
    ).advice
    assert "No further measurement is needed" not in advice
    assert "Causes need no further measurement" in advice
    assert "up to 18 um" in advice


def test_outliers_that_may_be_a_knock_are_decided_by_other_positions():
    tied = replace(NOTHING, verdicts=("tied",))
    assert tied.advice.startswith("No measurement")
    assert replace(tied, at_an_end=True).advice.startswith("Measure some of the other positions again")


def test_no_sentence_contradicts_a_figure():
    counted = 0
    for of in combinations():
        missing, residual, unexplained, advice, *notes = sentences(of)
        white = not of.significant and not of.dependence and of.tested and of.degrees_of_freedom >= FEW
        said = " ".join((missing, residual, advice, *notes, *(() if of.dependence else (unexplained,))))
        if not white:
            assert not [absent for absent in ABSENT if absent in said], (of, said)
        if of.verdicts or of.failed or of.undecided:
            assert "Nothing is missing" not in said, of
        if {"tied", "weak"} & set(of.verdicts) or of.failed or of.reason:
            assert "No further measurement" not in said, of
        if of.significant and not of.dependence:
            assert "p = " in missing
            assert "p = " not in residual  # stated once in the head
        if of.dependence:
            assert of.dependence in residual
        assert ("times the noise" in residual) == (of.condition not in ("depends", "not noise"))
        assert of.failed == () or "NOT USED: s2" in missing
        assert ("specified noise is too small" in said) <= (of.specified and of.chi2_reduced > FAR)
        assert ("too large;" in said) <= (of.specified and of.chi2_reduced < 1 / FAR)
        assert all(text.endswith(".") for text in (missing, unexplained, advice, *notes))
        assert len({*notes, missing, unexplained}) == 2 + len(notes)
        counted += 1
    assert counted > 1000


@pytest.mark.parametrize(
    ("figures", "missing", "advice"),
    [
        ({}, "Nothing is missing that these data can show", "No further measurement is needed"),
        ({"reason": "worse"}, "Nothing is missing that these data can show", "reason against the new calibration"),
        ({"significant": (IN_TIME,)}, "not noise (along time: p = 5e-46)", "Measure the same positions again"),
        ({"significant": (TOO_LARGE,)}, "larger than the specified noise (size (chi2): p = 1e-140)", "several times"),
        ({"degrees_of_freedom": 3.0}, "too few data", "Measure more positions"),
        ({"tested": False}, "too few data", "Measure more positions"),
        ({"dependence": "1 um depend on X"}, "no cause of the library explains", "in another order"),
        ({"verdicts": ("weak",)}, "Missing in the present model: it", "confirm a weak cause"),
        ({"verdicts": ("tied",)}, "Missing in the present model: it", "separates the tied causes"),
        ({"verdicts": ("strong",)}, "With it: 9 -> 3 um.", "No further measurement is needed"),
        ({"failed": ("s2",)}, "the data that were used", "s2 disagree"),
    ],
)
def test_each_condition_has_its_sentences(figures, missing, advice):
    of = replace(NOTHING, **figures)
    assert missing in of.missing("it" if of.verdicts else "", "9 -> 3 um")
    assert advice in of.advice
