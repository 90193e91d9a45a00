"""The commands answer as they did: each run of tests/golden/runs.py is compared with its stored answer."""

import pytest
from support.tiers import EXAM, STATISTICAL

from tests.golden.comparison import differences
from tests.golden.run import ANSWERS, answer, missing, stored
from tests.golden.runs import RUNS, Run
from tests.golden.volatile import masked

RENEW = "python -m tests.golden --renew {} stores the present answer."


@pytest.mark.parametrize(
    "run", [pytest.param(run, id=run.name, marks=[STATISTICAL] * run.heavy + [EXAM] * run.exam) for run in RUNS]
)
def test_the_answer_is_the_stored_one(run: Run) -> None:
    if absent := missing(run):
        pytest.skip(f"real data are not beside this repository: {absent[0]}")
    difference = differences(stored(run).read_text(encoding="utf-8"), answer(run), run.rounding)
    assert not difference, f"{run.name}\n{difference}\n{RENEW.format(run.name)}"


def test_each_run_has_one_answer() -> None:
    assert len({run.name for run in RUNS}) == len(RUNS)
    assert {path.name for path in ANSWERS.iterdir()} == {stored(run).name for run in RUNS}


STORED = "== shown\nbacklash X 12.08 um, 140 rows\n== a.json\nwidth: [12.0812345, 0.5]\nrank: 20\n"


@pytest.mark.parametrize(
    ("one", "other", "equal"),
    [
        ("12.08 um", "12.09 um", True),
        ("12.08 um", "12.10 um", False),
        ("140 rows", "141 rows", False),
        ("backlash X", "backlash Y", False),
        ("12.0812345", "12.0812346", True),
        ("12.0812345", "12.0813345", False),
        ("0.5]", "0.6]", False),
        ("rank: 20", "rank: 21", False),
        ("rank: 20", "rank: 20\nfurther: 1", False),
        ("width: [12.0812345, 0.5]\n", "", False),
    ],
)
def test_a_difference_is_found(one: str, other: str, equal: bool) -> None:
    present = STORED.replace(one, other)
    assert present != STORED
    shown = differences(STORED, present)
    assert (shown == "") == equal
    assert equal or any(
        line.startswith(("+", "-")) and not line.startswith(("+++", "---")) for line in shown.splitlines()
    )


def test_what_changes_from_day_to_day_is_masked() -> None:
    one = masked("made 2026-11-29 by ncomp 0.1.0 from ba1742f637da\nmade_at: 2026-11-29T15:48:10Z")
    assert one.splitlines()[1] == "made_at: DATE"
    assert "2026" not in one
    assert "ba1742" not in one
