"""The commands of `ncomp plan`: each has its own options, and the earlier form without their names still works."""

from __future__ import annotations

import pytest

from postproc.commands.options.declared import Signature
from postproc.commands.table import COMMANDS, command, named

PLANS = [name for name in COMMANDS if name.startswith("plan ")]
FORMS = {
    "--strategy grid -m gantry": "points --strategy grid -m gantry",
    "-m gantry --points 12 --optimise": "optimised -m gantry --points 12",
    "-m gantry --strategy on-the-fly --path in.nc": "path -m gantry --path in.nc",
    "--strategy=on-the-fly -m gantry": "path -m gantry",
    "--instrument touch-probe --strategy grid -m dmu50": "spheres --strategy grid -m dmu50",
    "-m dmu50 --instrument=touch-probe": "spheres -m dmu50",
}
"""Words of the earlier form, and those of the command."""


@pytest.mark.parametrize("earlier", FORMS)
def test_the_earlier_form_is_the_same_command(earlier):
    """Its answers are those of the runs `plan-...` in tests/golden/runs.py, which have this form."""
    assert named(["plan", *earlier.split()]) == named(["plan", *FORMS[earlier].split()])


def test_every_plan_has_its_own_options():
    options = {name: {each.label for each in Signature(command(name)[0]).declared} for name in PLANS}
    common = set.intersection(*options.values())
    assert common == {
        "--machine", "--output", "--range", "--target", "--seed", "--feed", "--nc", "--dialect", "--work-offset",
        "--json", "--report", "--report-head",
    }  # fmt: skip
    assert max(map(len, options.values())) <= 30


def test_a_plan_of_nothing_is_refused(ncomp):
    done = ncomp("plan", "pionts", "--machine", "gantry", "-o", "plan.csv")
    assert done.status == 2
    assert done.err == "ncomp: plan pionts: expected optimised, path, points or spheres (did you mean 'points'?)\n"


@pytest.mark.parametrize("words", [("plan",), ("plan", "--help"), ("help", "plan")])
def test_help_lists_what_is_planned(ncomp, words):
    shown = ncomp(*words)
    assert shown.status == 0
    for name in PLANS:
        assert f"ncomp {name} --machine" in " ".join(shown.out.decode().split())
