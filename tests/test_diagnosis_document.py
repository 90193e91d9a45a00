"""The page and the document of a diagnosis: what is wrong, what to do, the evidence, and what is not known."""

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from support.command import run_command
from support.pages import LINK, figures, panels, text_of
from support.virtual_measurements import THREE, measured, positions, written
from virtual_machine import draws

import machines
from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import Backlash, Cyclic, LocationError, ThermalDrift, Unnamed
from kinematics.error_model.model import ErrorModel, encode_model, no_errors

CFRAME, DMU50 = machines.load("cframe"), machines.load("dmu50")
FURTHER = {
    *("estimated_noise", "forced", "confirmed", "worse_than_none", "held_out", "unexplained_periods", "added"),
    *("sanity", "zeros", "by_direction_um", "volume_um", "visibility", "would_show_from", "not_tested", "outliers"),
    *("significant_share", "calibration", "unexplained_functions", "machine_change"),
}


class Told(NamedTuple):
    """What the command wrote and showed."""

    document: dict[str, Any]
    page: str
    lines: list[str]
    calibration: dict[str, Any]


def with_errors(*effects, machine=CFRAME) -> ErrorModel:
    return msgspec.structs.replace(no_errors(machine), effects=effects)


def there_and_back(*effects, rows=100, seed=2, height=None):
    """A C-frame with these errors, measured there and back; height: position of Z, mm, if it does not move."""
    rng = np.random.default_rng(seed)
    q = positions(CFRAME, rows // 2, rng, edges=30)
    if height is not None:
        q[:, CFRAME.index("Z")] = height
    return measured(CFRAME, np.concatenate([q, q[::-1]]), THREE, with_errors(*effects), rng)


def told(folder: Path, data: Path, *options: str, machine="cframe") -> Told:
    new, out, page = (folder / name for name in ("new.json", "out.json", "page.html"))
    files = ("-m", machine, "-o", new, "--json", out, "--report", page)
    done = run_command("diagnose", data, *files, *options)
    assert done.status == 0, done.shown
    document, calibration = (
        json.loads(path.read_text(encoding="utf-8"), parse_constant=pytest.fail) for path in (out, new)
    )
    return Told(document, page.read_text(encoding="utf-8"), done.shown.splitlines(), calibration)


@pytest.fixture(scope="module")
def several(tmp_path_factory):
    """Two causes of the machine, strong."""
    folder = tmp_path_factory.mktemp("several")
    found = there_and_back(Backlash("X", 200.0), ThermalDrift(component="X", rate=500.0))
    return told(folder, written(found, folder / "data.csv"))


def test_the_first_sentences_say_what_is_wrong_how_large_and_what_to_do(several):
    first = next(line for line in several.lines if line.startswith("Backlash X"))
    assert several.lines.index(first) < 2
    size, u = map(float, re.match(r"Backlash X: ([\d.]+) um \(U ([\d.]+) um\) at the tool point", first).groups())
    assert abs(size - 200.0) < 2.0 * u + 1.0
    assert "Preload or replace the nut" in first
    residual = next(line for line in several.lines if "residual" in line)
    assert re.search(r"residual [\d.]+ -> [\d.]+ um RMS, held-out blocks [\d.]+ -> [\d.]+ um", residual)
    assert several.lines.index(residual) < 3


def test_a_page_shows_the_evidence_for_each_cause(several):
    page = several.page
    causes = several.document["effects"]
    assert {cause["kind"] for cause in causes} == {"backlash", "thermal-drift"}
    assert len(figures(page)) >= len(causes) + 4
    assert not LINK.search(text_of(page))
    for cause in causes:
        assert f"{100 * cause['share']:.0f}\N{NO-BREAK SPACE}%" in page
    for figure in (several.document["before"], several.document["after"]):
        assert f"{figure['rms_um']:.2f}" in page
        assert f"{figure['heldout_rms_um']:.2f}" in page
    for said in ("bidirectional table", "ncomp verify", "direction of approach of X", "k=2", "Unidentifiable causes"):
        assert said in page
    order = [
        page.index(text) for text in ("Preload", "Origin and repair", "Map of the volume", "χ²/dof", "NOT VISIBLE")
    ]
    assert order == sorted(order)


def test_the_document_has_the_further_keys_too(several):
    assert set(several.document) >= FURTHER
    by_direction = several.document["by_direction_um"]
    assert set(by_direction["before"]) == set(by_direction["after"]) == set("xyz")
    assert several.document["volume_um"]["machine_max"] > 100.0
    smallest = {each["name"]: each for each in several.document["would_show_from"]}
    assert 0.0 < smallest["backlash Y"]["size"] < 10.0
    assert smallest["backlash Y"]["unit"] == "um"


def test_the_terminal_has_tables_of_100_columns_and_whole_names(several):
    text = "\n".join(several.lines)
    table = text[text.index("size ± U") : text.index("Origin and repair")].splitlines()
    assert max(map(len, table)) <= 100
    assert "…" not in text
    assert any(re.match(r" \d +backlash X ", line) for line in table)


def test_a_machine_without_a_cause_is_called_so(tmp_path):
    found = told(tmp_path, written(there_and_back(rows=80), tmp_path / "data.csv"), "--force")
    assert found.document["effects"] == []
    text = "\n".join(found.lines)
    assert "No cause was found" in text
    assert "Nothing is missing" in text
    assert "Share by cause" not in found.page
    assert figures(found.page)


def test_the_map_does_not_extend_along_an_axis_that_did_not_move(tmp_path):
    flat = there_and_back(Backlash("X", 100.0), height=-100.0)
    found = told(tmp_path, written(flat, tmp_path / "data.csv"))
    titles = [panel.get("title", "") for panel in panels(found.page)]
    assert any("without a correction: X and Y" in title for title in titles)
    assert not any(re.search(r": .*\bZ\b", title) for title in titles if "correction" in title)


def test_a_tie_names_the_other_cause_in_its_first_sentence_and_what_separates_it(tmp_path):
    """An axis that stops short by a share of its step looks like a backlash, in a sweep of equal steps."""
    (tmp_path / "data.csv").write_text(draws.tied_backlash("cframe", 1).sheet(), encoding="utf-8")
    found = told(tmp_path, tmp_path / "data.csv")
    first = next(line for line in found.lines if "TIED with" in line)
    assert "settling" in first
    assert "Similar causes" in found.page
    (cause,) = found.document["effects"]
    assert cause["verdict"] == "tied"
    odds = {each["kind"]: each["odds"] for each in cause["alternatives"]}
    assert {cause["kind"], *odds} >= {"backlash", "settling"}
    assert all(each < 150.0 for each in odds.values())
    proposal = found.document["moves"][0]
    assert proposal["says"] == found.document["next_measurement"]
    assert proposal["minutes"] > 0.0
    assert "settling" in proposal["says"]
    assert " min): this " in proposal["says"]


def function(*variables: str) -> Unnamed:
    """A displacement along Z without a name, of two variables."""
    terms = tuple((i, j) for i in range(1, 4) for j in range(1, 4))
    sizes = tuple(np.random.default_rng(2).normal(scale=15.0, size=len(terms)).tolist())
    ranges = [(0.0, 15.0 * 300) if name == "time" else CFRAME.axes[CFRAME.index(name)].travel for name in variables]
    return Unnamed("Z", variables, tuple(ranges), terms, sizes)


@pytest.fixture(scope="module")
def by_position(tmp_path_factory):
    """A measurement with a function of X and Y that has no name."""
    folder = tmp_path_factory.mktemp("function")
    return written(there_and_back(function("X", "Y"), rows=300), folder / "data.csv")


def coefficients(calibration: dict[str, Any]) -> list[float]:
    return [size for each in calibration["effects"] if each["kind"] == "unnamed" for size in each["coefficients"]]


def test_a_function_without_a_name_is_drawn_and_told_with_its_size(tmp_path, by_position):
    found = told(tmp_path, by_position)
    left = found.document["unexplained"]
    assert set(left["variables"]) == {"X", "Y"}
    assert 1.0 < left["rms_um"] < 60.0
    assert any(line.startswith("No cause explains: function of X, Y along Z") for line in found.lines)
    assert "Unexplained 1" in found.page
    assert "recurs with the position or with the time" in found.document["next_measurement"]
    assert not any(coefficients(found.calibration))
    assert found.document["added"] == []


def test_a_function_of_positions_is_added_on_request(tmp_path, by_position):
    found = told(tmp_path, by_position, "--unexplained", "add")
    assert found.document["added"] == ["function of X, Y along Z"]
    assert max(map(abs, coefficients(found.calibration))) > 1.0
    assert "The new calibration corrects it" in found.page


@pytest.mark.statistical
def test_a_function_of_the_time_is_not_added_and_the_page_says_why(tmp_path):
    data = written(there_and_back(function("X", "time"), rows=300), tmp_path / "data.csv")
    found = told(tmp_path, data, "--unexplained", "add")
    assert found.document["unexplained"] is not None
    assert found.document["added"] == []
    assert not any(coefficients(found.calibration))
    assert "does not come again" in found.page


@pytest.mark.statistical
def test_open_periods_of_a_rotary_axis_are_told_with_their_orders(tmp_path):
    """At steps of 5 deg, 30 and 42 waves in a turn look the same."""
    rng = np.random.default_rng(3)
    q = np.repeat(positions(DMU50, 5, rng, edges=3), 72, axis=0)
    q[:, DMU50.index("C")] = np.radians(np.tile(np.arange(0.0, 360.0, 5.0), 5))
    wave = Cyclic("C", "C", 12.0, (60.0,), (0.0,))
    data = measured(DMU50, q, THREE, with_errors(wave, machine=DMU50), rng)
    found = told(tmp_path, written(data, tmp_path / "data.csv"), "--force", machine="dmu50")
    assert found.document["unexplained_periods"]
    text = " ".join("\n".join(found.lines).split())
    assert "a wave along C whose period is open" in text
    assert "per turn)" in text


@pytest.mark.parametrize(("half_waves", "worse"), [(0, False), (1, True)])
def test_a_calibration_that_is_worse_than_none_is_called_so(tmp_path, half_waves, worse):
    """An encoder that was referenced anew half a wave away: the curve of the calibration is off along the axis."""
    rng, x = np.random.default_rng(4), np.linspace(0.0, 600.0, 25)
    for name, phase in (("then", 0.0), ("now", np.pi * half_waves)):
        rows = [
            f"X,{run},{'+' if run % 2 else '-'},{target:g},{15.0 * np.sin(target / 40.0 + phase) + rng.normal(0.0, 0.5):.3f}"
            for run in range(1, 5)
            for target in (x if run % 2 else x[::-1])
        ]
        head = (
            "# machine: cframe\n# instrument: interferometer\n# u_um: 0.5\naxis,run,direction,target_mm,deviation_um\n"
        )
        (tmp_path / f"{name}.csv").write_text(head + "\n".join(rows) + "\n")
    done = run_command("fit", tmp_path / "then.csv", "--machine", "cframe", "-o", tmp_path / "then.json")
    assert done.status == 0, done.shown
    found = told(tmp_path, tmp_path / "now.csv", "-c", tmp_path / "then.json", "--force")
    assert found.document["worse_than_none"] == worse
    first = next(line for line in found.lines if line.strip())
    assert ("WORSE THAN NONE" in first) == worse
    assert ("CONFIRMED" in first) != worse
    assert len(found.document["zeros"]) == 4


@pytest.mark.parametrize("factor", [pytest.param(0.02, marks=pytest.mark.statistical), 50.0])
def test_a_sheet_that_is_far_off_is_told_with_the_noise_that_was_found(tmp_path, factor):
    data = written(there_and_back(Backlash("X", 80.0)), tmp_path / "data.csv")
    stated = {"u_range_um_per_m": 0.5 * factor, "u_angle_um": 3.0 * factor, "u_angle_um_per_m": 3.0 * factor}
    found = told(tmp_path, data, *(part for key, u in stated.items() for part in ("--header", f"{key}={u}")))
    assert any(line.startswith("The residuals contradict the stated uncertainty") for line in found.lines)
    assert found.document["estimated_noise"]["instrument_factor"] == pytest.approx(1.0 / factor, rel=0.2)
    assert [cause["kind"] for cause in found.document["effects"]] == ["backlash"]


def test_an_angle_is_told_by_what_it_does_at_the_tool_point(tmp_path):
    """A squareness of 100 urad over the travel of the axis that is out of square."""
    low, high = CFRAME.axes[CFRAME.index("Y")].travel
    given = tmp_path / "given.json"
    given.write_bytes(encode_model(diagnose(there_and_back(rows=120, seed=3), force=True).model))
    data = written(there_and_back(LocationError("C", "Y", 100.0), rows=120), tmp_path / "data.csv")
    found = told(tmp_path, data, "-c", given)
    first = next(line for line in found.lines if "E_C0Y" in line)
    size, u = map(float, re.search(r": ([\d.]+) um \(U ([\d.]+) um\) at the tool point", first).groups())
    assert abs(size - 0.1 * (high - low)) < 2.0 * u + 1.0


def test_an_answer_shows_itself_in_a_session():
    found = diagnose(there_and_back(Backlash("X", 80.0)))
    assert "cframe" in repr(found)
    assert "backlash X" in repr(found)
    assert "Origin and repair" in found._repr_html_()
    (cause,) = found.causes
    assert (cause.kind, cause.where, cause.axis, cause.verdict) == ("backlash", "machine", "X", "strong")
    assert found.model.id == found.calibration.id
    assert found.next_measurement
    assert any("Cause 1" in title for title in found.plots)
