"""The report of a diagnosis: a figure for every kind of cause, and all that a person needs on one page."""

import io
import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from calibration.diagnosis.separability import Separability
from calibration.reports.diagnosis_json import diagnosis_json
from rich.console import Console
from support.pages import LINK, figures, text_of
from support.virtual_measurements import THREE, measured, positions

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.measurement.measurement import Target
from calibration.reports.causes.text import in_full, quantity_name, with_uncertainty
from calibration.reports.diagnosis import diagnosis_report
from calibration.reports.separability import separability_section
from kinematics.effects import (
    Backlash,
    Cyclic,
    ThermalDrift,
    TrackerDrift,
    Unnamed,
)
from kinematics.error_model.model import no_errors
from rendering.page import page as page_of
from rendering.si import si
from rendering.terminal import show

CFRAME = machines.load("cframe")
TARGETS = {name: Target(place) for name, place in (("t1", (0.0, 0.0, -120.0)), ("t2", (90.0, 40.0, -180.0)))}


def diagnosis_of(*effects, n=100, seed=2, variance="sheet"):
    """A diagnosis of a C-frame with these errors, measured there and back."""
    rng = np.random.default_rng(seed)
    q = positions(CFRAME, n // 2, rng, edges=30)
    model = msgspec.structs.replace(no_errors(CFRAME), effects=effects)
    return diagnose(measured(CFRAME, np.concatenate([q, q[::-1]]), THREE, model, rng), variance=variance)


@pytest.fixture(scope="module")
def several():
    """Two causes of the machine, strong; the variance of the noise is estimated."""
    return diagnosis_of(Backlash("X", 200.0), ThermalDrift(component="X", rate=500.0), variance="estimate")


@pytest.mark.statistical
def test_a_page_says_what_is_missing_and_shows_it(several):
    names = {cause.effect.name for cause in several.causes}
    assert "backlash X" in names
    page = page_of(diagnosis_report(several, "ncomp diagnose data.csv --machine cframe")).decode()
    assert 0.0 < several.unexplained_share < 0.9
    assert len(figures(page)) >= len(several.causes) + 3
    assert not LINK.search(text_of(page))
    for cause in several.causes:
        assert f"{100 * cause.share:.0f}\N{NO-BREAK SPACE}%" in page
        assert f"{cause.delta_bic:.0f}" in page
        for quantity in cause.effect.parameter_table:
            assert re.search(rf" {si(quantity.unit)}(\n|<)", page)
        for other in cause.alternatives[:3]:
            assert other.name in page
    for figure in (several.before.fit.rms_um, several.after.fit.rms_um, several.before.held_out_um):
        assert f"{figure:.2f}" in page
    for said in (
        "bidirectional table",
        "ncomp verify",
        "direction of X",
        "not noise",
        "k=2",
        "ncomp diagnose data.csv",
    ):
        assert said in page


@pytest.mark.statistical
def test_a_page_says_how_what_has_no_name_depends_on_each_variable():
    terms = tuple((i, j) for i in range(1, 4) for j in range(1, 6))
    sizes = tuple(np.random.default_rng(2).normal(scale=12.0, size=len(terms)).tolist())
    ranges = CFRAME.axes[CFRAME.index("X")].travel, (0.0, 15.0 * 120)
    found = diagnosis_of(Unnamed("Z", ("X", "time"), ranges, terms, sizes), n=120)
    assert found.unexplained is not None
    assert set(found.unexplained.variables) == {"X", "time"}
    assert 0.0 < found.unexplained_um < found.after.fit.rms_um
    assert {one.variable for one in found.one_by_one} >= {"X", "Y", "Z"}
    assert "recurs with the position or with the time" in found.next_measurement
    assert found.conclusion.condition == "depends"
    page = page_of(diagnosis_report(found, "ncomp diagnose data.csv --machine cframe")).decode()
    assert "Benjamini and Hochberg" in page
    for one in found.one_by_one:
        assert f"{one.correlation:.3f}" in page
    assert diagnosis_json(found)["one_by_one"][0]["variable"] == found.one_by_one[0].variable


@pytest.mark.statistical
def test_the_terminal_holds_whole_names_in_100_columns_without_colours(several):
    out = io.StringIO()
    show(diagnosis_report(several, "ncomp diagnose"), Console(file=out, highlight=False, markup=False, soft_wrap=True))
    said = out.getvalue()
    assert "\x1b" not in said
    table = said[said.index("size ± U") : said.index("Similar causes")].splitlines()
    assert max(map(len, table[:-1])) <= 100
    assert "…" not in said
    for cause in several.causes:
        assert any(re.match(rf" \d+ +{re.escape(cause.effect.name)} ", line) for line in table)


@pytest.mark.statistical
def test_a_refusal_and_the_verdict_come_first_and_the_design_after_the_result(several):
    assert {each["verdict"] for each in diagnosis_json(several)["design"]} <= {"visible", "tied", "not visible"}
    refused = replace(several.acceptance, objection="it predicts worse", forced=False)
    report = diagnosis_report(replace(several, acceptance=refused), "ncomp diagnose")
    out = io.StringIO()
    show(report, Console(file=out, highlight=False, markup=False, soft_wrap=True))
    design, missing = "Causes that this design can show", "Missing in the"
    for said, then in (
        (out.getvalue(), ("chi2/dof", "Unidentifiable causes")),
        (page_of(report).decode(), ("Share by cause", "χ²/dof", design, "Unidentifiable causes")),
    ):
        order = [said.index(text) for text in ("NOT WRITTEN: it", missing, *then)]
        assert order == sorted(order)
    (section,) = (each for each in report.sections if each.title == design)
    assert section.table is not None
    tied = next(row for row in section.table.rows if row[0] == "thermal-drift")
    assert re.search(r"Z.*: tracker-drift \(1\.00\)", tied[2])


def test_a_cell_lists_a_family_in_short():
    each = [Separability("cross-axis", f"E_X{i}", "visible", 0.5, (), "") for i in range(5)]
    (row,) = separability_section(each).table.rows
    assert row == ("cross-axis", "all 5", "", "")
    (row,) = separability_section([*each, each[0]._replace(verdict="not visible")]).table.rows
    assert row == ("cross-axis", "E_X0, E_X1, E_X2, 2 more", "", "E_X0")
    one = Separability("tracker-drift", "tracker-drift", "tied", 0.5, (("thermal-drift Y", 0.91),), "")
    two = [
        Separability("thermal-drift", f"thermal-drift {c}", "tied", 0.5, (("tracker-drift", cosine),), "")
        for c, cosine in (("X", 0.93), ("Y", 0.98))
    ]
    rows = separability_section([one, *two]).table.rows
    assert rows[0] == ("tracker-drift", "", "yes: thermal-drift (0.91)", "")
    assert rows[1] == ("thermal-drift", "", "X, Y: tracker-drift (0.98)", "")


@pytest.mark.statistical
def test_shares_are_of_the_same_noise_where_it_is_estimated(several):
    assert several.before.fit.measurement.noise.non_repeatability["X"] > 0.05
    assert several.after.fit.measurement.noise is None
    explained = sum(cause.share for cause in several.causes)
    assert several.unexplained_share < 0.5 < explained + several.unexplained_share < 1.6


def test_causes_are_named_in_full_among_others():
    assert [in_full(name) for name in ("E_XY(X)", "E_XY", "E_C0Y", "backlash X")] == [
        "cross-axis E_XY(X)", "E_XY", "E_C0Y", "backlash X",
    ]  # fmt: skip
    assert [quantity_name(q) for q in Cyclic("X", "X", 10.0, (1.0, 2.0), (0.0, 0.0)).parameter_table[:3]] == [
        "period", "sine 1", "sine 2",
    ]  # fmt: skip
    assert [quantity_name(q) for q in TrackerDrift().parameter_table[2:4]] == ["shift z", "turn x"]
    assert with_uncertainty(-0.03212, 0.365) == "-0.03 ± 0.73"
    assert with_uncertainty(20.0, 0.0) == "20"
    assert with_uncertainty(1834.2, 115.0) == "1834 ± 230"


@pytest.mark.statistical
def test_what_was_not_used_is_told_and_the_model_not_called_complete(several):
    after = several.after._replace(fit=replace(several.after.fit, failed=("s2",)))
    none = replace(several, causes=(), unexplained=None, after=after)
    report = diagnosis_report(none, "ncomp diagnose")
    page = page_of(report).decode()
    assert "Nothing is missing" not in page
    assert "NOT USED: s2" in page
    out = io.StringIO()
    show(report, Console(file=out, soft_wrap=True))
    assert "NOT USED: s2" in out.getvalue()
    assert "left out     set-ups s2" in out.getvalue()


@pytest.mark.statistical
def test_a_page_of_nothing_missing():
    found = diagnosis_of(n=80)
    assert not found.causes
    assert found.unexplained_share == 1.0
    page = page_of(diagnosis_report(found, "ncomp diagnose data.csv --machine cframe")).decode()
    assert "Nothing is missing" in page
    assert not LINK.search(text_of(page))
    assert figures(page)
