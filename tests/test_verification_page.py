"""The page of a verification: the tool path of both texts in 3-D, beside that of the correction."""

from pathlib import Path

import numpy as np
import pytest
from support.pages import figures, text_of

BOX = Path(__file__).parents[1] / "examples" / "box.nc"
SET_UP = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")


def paths(page):
    """The drawn tool paths: points, mm, and errors, um, by title; and the colours of the figure."""
    (found,) = [each for each in figures(page) if each["panels"][0]["traces"][0]["type"] == "scatter3d"]
    drawn = {}
    for panel in found["panels"]:
        (trace,) = panel["traces"]
        drawn[panel["title"]] = np.array([trace[key] for key in ("x", "y", "z", "customdata")], float)
    return drawn, found["colours"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


def test_the_path_of_both_texts_is_drawn_as_the_correction_draws_it(command, folder):
    corrected, page, own = (folder / name for name in ("box.nc", "verify.html", "correct.html"))
    assert command(BOX, *SET_UP, "-o", corrected, "--report", own).status == 0
    assert command("verify", BOX, corrected, *SET_UP, "--report", page).status == 0
    (ours, ours_colours), (theirs, colours) = paths(page), paths(own)
    assert list(ours) == list(theirs) == ["before", "after"]
    for title, drawn in ours.items():
        assert drawn.shape[1] > 500
        np.testing.assert_allclose(drawn, theirs[title], rtol=1e-4, atol=1e-4)
    assert np.nanmax(ours["after"][3]) < 0.05 * np.nanmax(ours["before"][3])
    assert ours_colours["title"] == colours["title"]
    assert ours_colours["cmax"] == pytest.approx(np.nanmax(ours["before"][3]), rel=1e-3)
    text = text_of(page)
    assert "Errors on the part" in text
    assert "relative to the datum, on one scale." in text


def test_the_path_is_drawn_by_the_true_model(command, folder):
    corrected, page = folder / "aligned.nc", folder / "aligned.html"
    assert command(BOX, *SET_UP, "-o", corrected).status == 0
    again = ("--align", "none", "--report", page)
    assert command("verify", BOX, corrected, *SET_UP, *again).status == 0
    drawn, _ = paths(page)
    assert np.nanmax(drawn["before"][3]) == 0.0
    assert np.nanmax(drawn["after"][3]) > 5.0
