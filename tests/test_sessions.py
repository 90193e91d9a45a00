"""Results in a session of Python: one line, tables in a notebook, figures of Plotly, columns for tables of data."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import ncomp
from calibration.instruments import LaserTracker

EXAMPLES = Path(__file__).parents[1] / "examples"
BOX = EXAMPLES / "box.nc"
SHORT = 200
"""Largest number of characters of a result in one line."""


@cache
def results():
    """One result of each kind, by the function that makes it."""
    setup = ncomp.set_up("dmu50", work_offset={"G54": (-30, -20, 150)}, tool_length={"T1": 80})
    done = ncomp.correct(BOX, "dmu50", setup=setup, traced=True)
    plan = ncomp.plan("gantry", "random", 60)
    true = ncomp.virtual_machine("gantry", seed=3)
    tracker = ncomp.VirtualInstrument(LaserTracker(u_range_um=0.5, u_angle_um=1.0))
    made = ncomp.simulate(plan, true, tracker, seed=3)
    found = ncomp.fit(made.measurement, basis="legendre:2", hold_out=False)
    return {
        "load_machine": plan.machine,
        "set_up": setup,
        "correct": done,
        "moves": done.moves,
        "report": done.report,
        "check": ncomp.check(BOX, "dmu50", setup=setup),
        "verify": ncomp.verify(BOX, done.text, "dmu50", setup=setup, traced=True),
        "plan": plan,
        "virtual_machine": true,
        "simulate": made,
        "measurement": made.measurement,
        "fit": found,
        "predict": ncomp.predict(plan.positions / plan.machine.scale, "gantry", found.model),
        "compare": ncomp.compare(true, found.model),
        "export": ncomp.export("dmu50", "csv"),
    }


NAMES = (
    *("load_machine", "set_up", "correct", "moves", "report", "check", "verify", "plan", "virtual_machine"),
    *("simulate", "measurement", "fit", "predict", "compare", "export"),
)
WITH_TABLES = ("correct", "check", "verify", "plan", "fit")


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_one_short_line(name):
    line = repr(results()[name])
    assert len(line) < SHORT
    assert line.startswith("<")
    assert line.isprintable()


@pytest.mark.parametrize("name", WITH_TABLES)
def test_a_notebook_shows_the_tables_of_the_report(name):
    html = results()[name]._repr_html_()
    assert html.count("<table>") == html.count("</table>") > 0
    assert "<h3>" in html
    assert len(html) < 200_000


def test_the_tables_are_those_of_the_page(command):
    assert (
        command(
            *("correct", BOX, "-m", "dmu50", "-o", "out.nc", "--report", "page.html"),
            *("--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80"),
        ).status
        == 0
    )
    page = Path("page.html").read_text()
    report = results()["correct"].report
    largest = f"{report.before.largest:.2f}"
    assert largest in page
    assert largest in results()["correct"]._repr_html_()


@pytest.mark.parametrize("name", ["correct", "verify", "plan", "fit"])
def test_figures_are_objects_of_plotly(name):
    from plotly.graph_objects import Figure

    plots = results()[name].plots
    assert plots
    assert all(isinstance(each, Figure) and len(each.data) for each in plots.values())


def test_moves_have_the_lines_of_the_program():
    done = results()["correct"]
    lines = done.text.splitlines()
    moves = done.moves
    assert len(moves.line) == len(moves)
    arc = int(np.flatnonzero(moves.columns["kind"] == "arc")[0])
    assert lines[moves.line[arc] - 1].startswith(("G2", "G3"))


@pytest.mark.parametrize("name", ["moves", "plan", "measurement", "predict"])
def test_columns_are_of_one_length(name):
    result = results()[name]
    lengths = {len(column) for column in result.columns.values()}
    assert len(lengths) == 1
    assert {"X", "Y", "Z"} <= result.columns.keys()


def test_columns_of_a_prediction_are_its_numbers():
    found = results()["predict"]
    np.testing.assert_array_equal(found.columns["dx_um"], found.deviation_um[:, 0])
    np.testing.assert_array_equal(found.columns["u_dz_um"], found.u_um[:, 2])


def test_a_session_imports_neither_pandas_nor_polars():
    code = (
        "import ncomp, sys; p = ncomp.plan('gantry', 'random', 5); p.columns; repr(p); p._repr_html_();"
        "print([name for name in ('pandas', 'polars', 'plotly', 'IPython') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=EXAMPLES.parent)
    assert done.stdout.strip() == "[]"
