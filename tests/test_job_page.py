"""The page of a correction: the numbers of the run, bounded figures, and no page where there is no program."""

import itertools
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.pages import LINK, figures, panels, text_of, texts
from support.programs import load, random_model, shifted
from support.tiers import drawn

from kinematics.error_model.model import write_model
from postproc.evaluation import trace

BOX = Path(__file__).parents[1] / "examples" / "box.nc"
DEMO = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")
GANTRY = ("--machine", "gantry", "--calibration", "cal.json")
LONG = "G21 G17 G90\nG0 X500.0 Y500.0 Z100.0\n" + "".join(
    f"G1 X{500 + 10 * np.cos(i / 9):.3f} Y{500 + i}.5 Z{100 + i % 7}.0 F500\n" for i in range(150)
)


@pytest.fixture
def ncomp(command, tmp_path):
    """The command line, in a folder of its own with a program and a calibration."""
    (tmp_path / "in.nc").write_text(LONG)
    write_model(random_model(load("gantry"), 5), tmp_path / "cal.json")
    return command


LONG_RUN: dict[str, bytes] = {}
"""Calibration and outputs of the long program with a page."""


@pytest.fixture
def with_page(ncomp):
    """The folder holds out.nc, out.json and out.html of the program, which is corrected once."""
    if not LONG_RUN:
        done = ncomp("in.nc", *GANTRY, "-o", "out.nc", "--json", "out.json", "--report", "out.html")
        assert done.status == 0, done.err
        LONG_RUN.update({name: Path(name).read_bytes() for name in ("cal.json", "out.nc", "out.json", "out.html")})
    for name, content in LONG_RUN.items():
        Path(name).write_bytes(content)
    return ncomp


def table(page, title):
    """Rows of the table of a section, by their first cell."""
    section = page.split(f"<h2>{title}</h2>")[1].split("<section")[0]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", section, re.DOTALL)]
    return {row[0]: row[1:] for row in rows if row}


def test_page_of_the_demo(command):
    done = command(BOX, *DEMO, "-o", "out.nc", "--json", "out.json", "--report", "out.html")
    assert (done.status, done.out) == (0, b"")
    page, results = Path("out.html").read_text(), json.loads(Path("out.json").read_text())
    _numbers_agree(page, results)
    assert "DEMONSTRATION CALIBRATION" in page.split('class="verdict">')[1].split("</p>")[0]
    setup = table(page, "Set-up")
    assert setup["work offsets"] == ["G54: X -30, Y -20, Z 150"]
    assert setup["tool lengths"] == ["T1: 80 (mm)"]
    assert setup["datum"] == [
        "G54: probed (default) at X -30 Y -20 Z 150 B 0 C 0; probe 80 mm, the length of the first tool"
    ]
    assert "with --datum G54=true, enter X -29.9670, Y -20.0169, Z 150.0159" in setup["true datum"][0]
    options = table(page, "Options and inputs")
    assert options["classes"] == ["all but FOR"]
    assert f"SHA-256 {results['program']['sha256']}" in setup["program"][0]
    notes = page.split("<h2>Notes</h2>")[1].split("<section")[0]
    assert all(note in notes for note in results["notes"])
    plan, along, corrections = texts(page)
    assert "error, µm" in along
    assert "after, enlarged" in along
    assert all(f"Axis {axis}" in corrections for axis in "XYZ")
    assert all(f"{axis}, mm" in plan for axis in "xyz")
    assert "tool point error, µm" in plan
    assert not LINK.search(text_of(page))
    path = figures(page)[0]
    before, after = (np.array(panel["traces"][0]["customdata"], float) for panel in path["panels"])
    assert path["colours"]["cmax"] == pytest.approx(np.nanmax(before), rel=1e-4)
    assert np.nanmax(before) == pytest.approx(results["predicted_error_um"]["before"]["max"], rel=0.02)
    assert np.nanmax(after) < 0.3
    largest = max(panels(page)[2]["traces"][0]["y"], key=lambda y: y or 0.0)
    assert largest == pytest.approx(results["predicted_error_um"]["before"]["max"], rel=1e-3)


def _numbers_agree(page, results):
    errors, predicted = table(page, "Errors"), results["predicted_error_um"]
    error = "error relative to the datum" if results["errors_relative_to"] == "datum" else "error"
    for name, key in (
        (f"{error} at block ends before", "before"),
        (f"{error} at block ends after", "after"),
        (f"{error} between block ends after", "between_block_ends_after"),
        ("standard uncertainty (k=1)", "standard_uncertainty_of_prediction"),
    ):
        _same(errors[name], predicted[key])
    for key, numbers in results["predicted_absolute_error_um"].items() if error != "error" else ():
        _same(errors[f"absolute error at block ends {key}"], numbers)
    unknown = results["moves"]["not_judged"]
    assert (f"Without a predicted error: {unknown} of {results['moves']['read']} moves" in page) == bool(unknown)
    for axis, numbers in results["correction_um"].items():
        _same(table(page, "Corrections")[f"correction {axis}"], numbers)
    verdict = page.split('class="verdict">')[1].split("</p>")[0]
    before, after = predicted["before"], predicted["after"]
    assert f"{before['rms']:.2f} → {after['rms']:.2f}" in verdict
    largest = predicted["anywhere"]
    assert f"{largest['before']:.2f} → {largest['after']:.2f}" in verdict


def _same(cells, numbers):
    largest, rms, count = cells
    assert (float(largest), float(rms)) == pytest.approx((numbers["max"], numbers["rms"]), abs=6e-3)
    assert int(count) == numbers["count"]


@pytest.mark.usefixtures("with_page")
def test_largest_errors_are_those_of_the_run():
    page, results = Path("out.html").read_text(), json.loads(Path("out.json").read_text())
    _numbers_agree(page, results)
    lines = Path("in.nc").read_text().splitlines()
    for column, what in ((0, "before"), (1, "after")):
        rows = table(page, f"Largest errors {what}")
        sizes = [float(cells[column]) for cells in rows.values()]
        assert sizes == sorted(sizes, reverse=True)
        assert sizes[0] == pytest.approx(results["predicted_error_um"][what]["max"], abs=6e-3)
        for line, cells in rows.items():
            for axis, value in zip([axis.name for axis in load("gantry").axes], cells[2:], strict=False):
                assert float(re.search(rf"{axis}([-\d.]+)", lines[int(line) - 1])[1]) == float(value)


def test_the_program_is_the_same_without_a_page(with_page):
    assert with_page("in.nc", *GANTRY, "-o", "without.nc").status == 0
    assert Path("out.nc").read_bytes() == Path("without.nc").read_bytes()


def test_long_programs_are_drawn_in_steps(ncomp, monkeypatch):
    monkeypatch.setattr(trace, "BINS", 16)
    monkeypatch.setattr(trace, "PATHS", 20)
    assert ncomp("in.nc", *GANTRY, "-o", "out.nc", "--json", "out.json", "--report", "out.html").status == 0
    page = Path("out.html").read_text()
    assert "Each step joins 16 moves" in page
    assert "One feed move of" in page
    _numbers_agree(page, json.loads(Path("out.json").read_text()))


def test_without_errors_there_is_nothing_to_draw(ncomp):
    assert ncomp("in.nc", "--machine", "gantry", "-c", "none", "-o", "out.nc", "--report", "out.html").status == 0
    page = Path("out.html").read_text()
    assert "written back as it was" in page
    assert not texts(page)
    assert Path("out.nc").read_text() == LONG


def test_a_program_that_says_too_little_is_not_judged(ncomp, tmp_path):
    write_model(shifted(load("gantry"), X=-10.0), tmp_path / "shift.json")
    Path("in.nc").write_text("G21 G90\nG1 X50.0 F100\n")
    options = ("--machine", "gantry", "-c", "shift.json", "--datum", "G54=true")
    done = ncomp("in.nc", *options, "-o", "out.nc", "--report", "-")
    assert done.status == 0
    page = done.out.decode()
    assert "No error is evaluated" in page
    assert table(page, "Corrections")["correction X"] == ["10.00", "10.00", "1"]
    assert len(texts(page)) == 1


def test_what_stays_whole_is_named_by_reason(ncomp):
    Path("in.nc").write_text("G21 G90\nG0 X100.0 Y100.0 Z100.0\nG1 X1500.0 F100 M9\n")
    ncomp("in.nc", *GANTRY, "-o", "out.nc", "--json", "out.json", "--report", "out.html")
    (whole,) = json.loads(Path("out.json").read_text())["not_split"]
    (row,) = table(Path("out.html").read_text(), "Moves that were not split").items()
    assert row == (whole["reason"], [f"{whole['strays_up_to_um']:.2f}", "3"])
    assert "M function" in whole["reason"]


@pytest.mark.parametrize("line", ["G31 X5", "G1 X#500", "G1 X9000.0"])
def test_a_refusal_leaves_no_page(ncomp, tmp_path, line):
    Path("in.nc").write_text(LONG + line + "\n")
    before = sorted(tmp_path.iterdir())
    done = ncomp("in.nc", *GANTRY, "-o", "out.nc", "--report", "out.html")
    assert done.status == 2
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("-o", "a", "--report", "./a"), "--output and --report both name ./a"),
        (("-o", "a", "--json", "b", "--report", "b"), "--json and --report both name b"),
        (("--report", "-"), "--output and --report cannot both go to standard output"),
        (("-o", "a", "--report", "in.nc"), "in.nc is an input and would be overwritten"),
        (("-o", "a", "--report", "cal.json"), "cal.json is an input and would be overwritten"),
        (("-o", "a", "--report", "no/a.html"), "cannot write no/a.html: No such file or directory"),
    ],
)
def test_places_are_checked_beforehand(ncomp, tmp_path, options, words):
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    done = ncomp("in.nc", *GANTRY, *options)
    assert (done.status, done.out) == (2, b"")
    assert words in done.err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.usefixtures("ncomp")
def test_what_draws_is_loaded_on_demand():
    arguments = ["ncomp", "in.nc", *GANTRY, "-o", "out.nc"]
    code = f"import sys; sys.argv = {arguments!r}\nfrom postproc.cli import run\ntry: run()\nexcept SystemExit: pass\n"
    code += "print(*(name.partition('.')[0] for name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert Path("out.nc").exists()
    assert not set(done.stdout.split()) & {"plotly", "jinja2", "calibration"}


# ---- what is kept of a program

sizes = st.lists(st.integers(0, 60), min_size=1, max_size=8)


@drawn(25, 100, chunks=sizes, half=st.integers(1, 5), seed=st.integers(0, 99))
def test_stretches_hold_the_extremes_and_rms_of_their_moves(chunks, half, seed):
    rng = np.random.default_rng(seed)
    count = sum(chunks)
    errors, corrections = rng.uniform(0, 50, (count, 2)), rng.normal(size=(count, 3))
    errors[rng.random(count) < 0.2] = np.nan
    lines = rng.integers(1, 99, count)  # loops repeat their lines
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trace, "BINS", 2 * half)
        bins = trace.Bins(3)
        for first, last in itertools.pairwise(np.cumsum([0, *chunks])):
            bins.add(errors[first:last], corrections[first:last], lines[first:last])
    assert len(bins) <= 2 * half
    assert bins.edges[-1] == count
    low, high = bins.corrections
    for i, (first, last) in enumerate(itertools.pairwise(bins.edges.astype(int))):
        judged = errors[first:last][~np.isnan(errors[first:last, 0])]
        expected = (judged.max(axis=0), np.sqrt((judged**2).mean(axis=0))) if len(judged) else (np.nan, np.nan)
        np.testing.assert_allclose(bins.largest[i], expected[0])
        np.testing.assert_allclose(bins.rms[i], expected[1])
        assert bins.lines[i] == lines[first]
        np.testing.assert_array_equal(low[i], corrections[first:last].min(axis=0))
        np.testing.assert_array_equal(high[i], corrections[first:last].max(axis=0))


@given(sizes, st.integers(1, 9))
def test_ways_are_thinned_evenly(chunks, most):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trace, "PATHS", most)
        ways = trace.DrawnPaths()
        for first, last in itertools.pairwise(np.cumsum([0, *chunks]).tolist()):
            kept = ways.rows(np.arange(first, last))
            one = np.broadcast_to(kept[:, None], (len(kept), trace.SEGMENTS + 1)).astype(float)
            ways.add(np.repeat(one[:, :, None], 3, axis=2), np.repeat(one[:, :, None], 2, axis=2))
    assert len(ways.points) <= most
    np.testing.assert_array_equal(ways.errors[:, 0, 1], np.arange(0, sum(chunks), ways.stride))
