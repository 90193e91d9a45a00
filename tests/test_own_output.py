"""Outputs of random contours and cycles are read again, and verified with the errors that the run has claimed."""

import pytest

from tests.fuzz.case import Verdict, examiner
from tests.fuzz.runner import judge


@pytest.mark.parametrize("seed", range(9))
@pytest.mark.parametrize("name", ["contours", "cycles"])
def test_a_few_programs(name, seed):
    """`make fuzz`, and test_fuzz.py with the tests of many draws, examine more."""
    module = examiner(name)
    outcome = judge(module, module.draw(seed))
    assert outcome.verdict is Verdict.COMPARED, outcome.text
