"""Differences that the fuzzers have found stay away, and programs at random of each show no new one."""

import json
import random
import re
import resource
from dataclasses import replace
from pathlib import Path

import pytest
from clients import nc_gcode
from support.tiers import EXAM, STATISTICAL

from postproc.text import flow
from tests.fuzz import EXAMINERS
from tests.fuzz.case import FOUND, Case, Outcome, Verdict, examiner, load, save
from tests.fuzz.gantry import constant, flat
from tests.fuzz.mutated_programs import limited
from tests.fuzz.ncomp import correct
from tests.fuzz.runner import Count, judge, run
from tests.fuzz.shrink import shrink

FILES = sorted(FOUND.glob("*/*.json"))
PROGRAMS, EXAM_PROGRAMS = 40, 200
NEEDS_LINUXCNC = ("linuxcnc", "linuxcnc_files", "play")


@pytest.fixture(autouse=True)
def client(request: pytest.FixtureRequest) -> None:
    """LinuxCNC, where the examiner needs it."""
    parameters = getattr(request.node, "callspec", None)
    values = {str(getattr(value, "parent", value)) for value in parameters.params.values()} if parameters else set()
    names = {Path(value).name for value in values}
    if names & set(NEEDS_LINUXCNC):
        request.getfixturevalue("linuxcnc")
    if "simulator" in names:
        request.getfixturevalue("linuxcnc_sim")
    if "siemens" in names and not nc_gcode.available():
        pytest.skip("nc-gcode-interpreter is not here: .ci/run makes .nc_gcode where Python 3.12 or later is")


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_found_before(path):
    outcome = judge(examiner(path.parent.name), load(path))
    assert outcome.verdict is not Verdict.DIFFERS, f"{outcome.text}\nfound: {json.loads(path.read_text())['detail']}"


@pytest.mark.parametrize(
    "programs", [pytest.param(PROGRAMS, marks=STATISTICAL), pytest.param(EXAM_PROGRAMS, marks=EXAM)]
)
@pytest.mark.parametrize("name", EXAMINERS)
def test_random_programs(name, programs):
    if programs == PROGRAMS:
        programs = getattr(examiner(name), "PROGRAMS", PROGRAMS)
    count = run(name, programs, seed=0, keep=False)
    print(count.text())
    assert not count.differences, count.text()
    assert count.compared >= programs * getattr(examiner(name), "LEAST_COMPARED", 0.25)


def test_a_case_is_read_as_it_was_written(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.fuzz.case.FOUND", tmp_path)
    case = Case("G0 X1\r\nM2\xe9\r\n", "part.h", "dmu50", "{}\n", ("--unroll",), {"tool.t": "a\nb"})
    path = save("linuxcnc", case, Outcome(Verdict.DIFFERS, "line ends: 3 um"))
    assert load(path) == case
    assert path.name.startswith("line_ends_")


def test_the_smallest_program_that_differs():
    text = "N1 G0 X1\nN2 G1 Y2 F[3 + 4] (a comment)\nM2\n"
    assert shrink(text, lambda text: "Y2" in text).split() == ["Y2"]
    assert shrink(text, lambda text: "F[3 + 4]" in text).strip() == "F[3 + 4]"


def test_classes_are_counted():
    count = Count()
    for outcome in (Outcome(Verdict.COMPARED), Outcome(Verdict.REFUSED, "G7"), Outcome(Verdict.DIFFERS, "end: 1")):
        count.add(outcome)
    assert count.line() == "3 programs, 1 compared, 1 refused, 1 differences"
    assert count.differences == {"end": 1}


PROGRAM = (
    "G21 G90 G17 F500\nG54 G0 X1. Y2. Z30.\nG0 X10. Y20. Z25.\nG1 X60. M8\nG2 X60. Y40. J10.\nG1 X20. Y5. Z-3.\nM2\n"
)


@pytest.mark.usefixtures("linuxcnc")
@pytest.mark.parametrize("name", ["linuxcnc", "play"])
@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        (r"X60\.\d*(?= .*M8)", "X60.9", {"end", "between ends", "line"}),
        (r"M8", "M9", {"other calls"}),
        (r"\nG2 .*", "", {"missing move", "kind of move"}),
        (r"\nM2", "\nG0 X0 Y0 Z0\nM2", {"extra move"}),
        (r"G1 .*TAKE-UP.*\n", "", {"arc", "line"}),
    ],
)
def test_what_is_spoilt_differs(name, old, new, kind, monkeypatch):
    """The examiners see a position, a switch, a move and a take-up that are wrong."""
    module = examiner(name)
    case = replace(module.draw(2), program=PROGRAM)
    rng = random.Random(0)
    errors = constant(rng) if name == "linuxcnc" else flat(rng, (15.0, 15.0, 15.0))
    case = replace(case, calibration=errors.text(), options=tuple(o for o in case.options if o != "--unroll"))
    assert judge(module, case) == Outcome(Verdict.COMPARED)
    written = correct(case)
    spoilt = re.sub(old, new, written.text)
    if spoilt == written.text:
        assert name == "linuxcnc"  # nothing is taken up without backlash
        return
    monkeypatch.setattr("tests.fuzz.linuxcnc.correct", lambda _: written._replace(text=spoilt))
    assert judge(module, case).kind in kind


def test_limits_of_an_examination_are_undone():
    before = flow.MOST_RUN_BLOCKS, resource.getrlimit(resource.RLIMIT_AS)
    with limited(10):
        assert before[0] > flow.MOST_RUN_BLOCKS
    assert before == (flow.MOST_RUN_BLOCKS, resource.getrlimit(resource.RLIMIT_AS))
