"""What the pages of reports state, and in which words: entered by the commands that write them."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.command import succeed
from support.pages import panels, text_of, texts

from kinematics.files.number_text import amount, plus_minus, uncertainty

EXAMPLES = Path(__file__).parents[1] / "examples"
SET_UP = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")


def section(page, title):
    """The text of a section of a page, without its marks."""
    (found,) = [part for part in text_of(page).split("<section")[1:] if f"<h2>{title}</h2>" in part]
    return re.sub(r"<[^>]+>", " ", found.partition(">")[2].partition("</section>")[0])


@pytest.fixture
def box(tmp_path, monkeypatch):
    """The folder of the test with the program of the demonstration."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(EXAMPLES / "box.nc", tmp_path)
    return tmp_path


def test_the_figures_of_a_correction_count_lines_of_the_program(box):
    succeed("box.nc", *SET_UP, "-o", "out.nc", "--report", "out.html")
    found = [panel for panel in panels(box / "out.html") if panel.get("kind", "xy") == "xy"]
    lines = Path("box.nc").read_text().splitlines()
    for panel in found:
        assert panel["x"].startswith("line of the program")
        numbers = [int(text) for text in panel["axes"]["xaxis"]["ticktext"]]
        assert all(re.search(r"[XYZBC]", lines[number - 1]) for number in numbers)
        for trace in panel["traces"]:
            assert "line %{customdata}" in trace["hovertemplate"]
            assert len(trace["customdata"]) == len(trace["x"])


LOOP = "G21 G90 G54\nT1 M6\nG43 H1\nG0 X0 Y0 Z100\n#1=0\nWHILE [#1 LT 3] DO1\nG1 X10 F500\nX20\n#1=[#1+1]\nEND1\nM30\n"


def test_a_loop_repeats_the_numbers_of_its_lines(box):
    (box / "loop.nc").write_text(LOOP)
    succeed("loop.nc", *SET_UP, "-o", "out.nc", "--report", "out.html")
    panel = next(panel for panel in panels(box / "out.html") if panel.get("kind", "xy") == "xy")
    assert [int(text) for text in panel["axes"]["xaxis"]["ticktext"]][-6:] == [7, 8, 7, 8, 7, 8]


def test_a_correction_states_how_sure_its_improvement_is_in_a_sentence(box):
    done = succeed("box.nc", *SET_UP, "-o", "out.nc", "--report", "out.html")
    for shown in (done.err, section(box / "out.html", "Errors")):
        text = " ".join(shown.replace("\N{NO-BREAK SPACE}", " ").split())
        assert re.search(r"\d+ % of the improvement is certain: .* twice its standard uncertainty \(k=2\)", text)
        assert "significant share" not in text
    assert "which the correction takes into account, so nothing is to be done" in " ".join(done.err.split())


def test_each_printed_sheet_names_the_program_and_its_hash(box):
    succeed("box.nc", *SET_UP, "-o", "out.nc", "--report", "out.html", "--json", "out.json")
    page, known = (box / "out.html").read_text(), json.loads((box / "out.json").read_text())["program"]["sha256"]
    foot = re.search(r'@bottom-left { content: "(.*?)"', page)[1]
    foot = re.sub(r"\\([0-9a-f]+) ", lambda code: chr(int(code[1], 16)), foot)
    assert foot.startswith(f"ncomp · box.nc, SHA-256 {known} · machine dmu50")
    assert known.upper() in (box / "out.nc").read_text()  # in its mark
    assert '<div class="approved_by gap"><dt>approved by</dt>' in page


def test_a_folder_states_the_set_up_and_the_hash_of_each_program(box):
    (box / "in").mkdir()
    (box / "box.nc").rename(box / "in/box.nc")
    done = succeed("batch", "in", "out", *SET_UP, "--report", "batch.html", "--json", "batch.json")
    ((program,), folder) = (
        json.loads((box / "batch.json").read_text())["programs"],
        section(box / "batch.html", "Set-ups"),
    )
    for text in (folder, done.shown[done.shown.index("Set-ups") :]):
        words = " ".join(text.split())
        assert program["result"]["program"]["sha256"] in words
        assert f"{program['result']['predicted_error_um']['between_block_ends_after']['max']:.2f}" in words
    assert "G54: X -30, Y -20, Z 150" in folder
    assert "G54: probed at X -30 Y -20 Z 150 B 0 C 0, probe 80 mm" in folder
    assert "T1: 80" in folder


TURNTABLE = 'name = "turntable"\nchain = "w b C t"\n[axes.C]\ntravel = [0, 360]\npoint = [0, 0, 0]\nhome = 0\n'


@pytest.fixture(scope="module")
def turntable(tmp_path_factory):
    """What `fit` and `diagnose` show of a rotary axis with backlash, and the page of the diagnosis."""
    folder, rng = tmp_path_factory.mktemp("turntable"), np.random.default_rng(7)
    rows = [
        f"{60 * k},C,{run},{sign},{at},{20 * np.sin(np.radians(at)) - 15 * int(sign + '1') + rng.normal(scale=2.0):.2f}"
        for run in (1, 2, 3)
        for sign, order in (("+", range(0, 360, 15)), ("-", range(345, -1, -15)))
        for k, at in enumerate(order, start=run * 1000)
    ]
    rows = [f"{60 * k},{row.partition(',')[2]}" for k, row in enumerate(rows)]
    head = "# machine: turntable\n# instrument: interferometer\n# u_um: 2\n# target.t: 0 0 0\n"
    (folder / "c.csv").write_text(
        f"{head}time_s,axis,run,direction,target_deg,deviation_urad\n" + "\n".join(rows) + "\n"
    )
    (folder / "turntable.toml").write_text(TURNTABLE)
    machine = ("--machine", folder / "turntable.toml")
    fitted = succeed("fit", folder / "c.csv", *machine, "-o", folder / "fit.json").shown
    page = folder / "page.html"
    found = succeed("diagnose", folder / "c.csv", *machine, "-o", folder / "new.json", "--report", page).shown
    return fitted, found, page


def test_residuals_of_a_rotary_axis_are_in_urad(turntable):
    fitted, found, page = turntable
    assert re.search(r"Residual [\d.]+ -> [\d.]+ urad RMS", fitted)
    assert re.search(r"residual [\d.]+ -> [\d.]+ urad RMS, held-out blocks [\d.]+ -> [\d.]+ urad", found)
    for shown in (fitted, found):
        assert not re.search(r"residual[^.]*\d um\b", shown)
        assert "residual, um" not in shown
    assert "residual, µrad" in "\n".join(texts(page))
    assert "residual, µm" not in "\n".join(texts(page))


def test_the_words_of_a_diagnosis_explain_themselves(turntable):
    _, found, page = turntable
    causes, residual = (section(page, title) for title in ("Causes", "Residual before and after"))
    assert re.search(r"\d to 1", causes)
    assert "how many times likelier" in " ".join(causes.split())
    assert "the largest difference between two states" in " ".join(causes.split())
    assert "expected of noise alone" in residual
    assert "Causes that this design can show" not in found


def test_a_size_that_two_decimals_do_not_show_is_not_zero():
    assert amount(0.0, "um") == amount(0.0031, "um") == "less than 0.01 um"
    assert amount(0.0051, "urad") == "0.01 urad"


def test_an_uncertainty_is_not_shown_as_zero():
    assert (uncertainty(0.26, 1), uncertainty(0.044, 1), uncertainty(0.00002, 2)) == ("0.3", "0.04", "2e-05")
    assert plus_minus(12.3456, 0.0032, 2) == "12.346 ± 0.003"
    assert plus_minus(12.3456, 0.32, 2, "+") == "+12.35 ± 0.32"
    assert (plus_minus(-0.001, 0.5, 1), plus_minus(1.0, 0.0, 2)) == ("0.0 ± 0.5", "1.00")


def test_an_export_states_one_error_over_the_volume(box):
    succeed("export", "--machine", "dmu50", "--format", "linuxcnc", "-o", "tables", "--report", "export.html")
    page = box / "export.html"
    verdict = re.search(r'<p class="verdict[^>]*>(.*?)</p>', text_of(page), re.DOTALL)[1]
    before, after = re.search(r"over the volume: ([\d.]+) → ([\d.]+) µm RMS", verdict).groups()
    remaining = section(page, "Remaining errors over the volume")
    assert before in remaining
    assert after in remaining
    assert not re.search(r"[\d.]+ µm", section(page, "Map of the volume"))
