"""A move is refused where its end or the bulk of its path is worse than in the input; a worse part is noted.

The words of ordinary programs are rounded: what the rounding of the input alone does is never a refusal.
"""

import json
import re
from pathlib import Path

import pytest
from support.programs import load, model_of

import machines
from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion
from kinematics.error_model.model import write_model

GANTRY = load("gantry")
PLAY = [Backlash(axis, width) for axis, width in (("X", 14.0), ("Y", 20.0), ("Z", 9.0))]
RECTANGLES = {
    "part.nc": "G21 G90 G17 G54\nT1 M6\nG0 X-20. Y-20. Z5.\nG1 Z-2. F500\nG41 D1 X0. Y-10.\nY60.\nX80.\nY0.\nX-10.\nG40 X-20. Y-20.\nG0 Z5.\nM30\n",
    "part.mpf": "G17 G90 G710 G54\nT1 D1 M6\nG0 X-20 Y-20 Z5\nG1 Z-2 F500\nG41 X0 Y-10\nY60\nX80\nY0\nX-10\nG40 X-20 Y-20\nG0 Z5\nM30\n",
    "part.h": "BEGIN PGM A MM\nTOOL CALL 1 Z S1000\nL X-20 Y-20 Z+5 R0 FMAX\nL Z-2 F500\nL X+0 Y-10 RL\nL Y+60\nL X+80\nL Y+0\nL X-10\nL X-20 Y-20 R0\nL Z+5 FMAX\nM30\nEND PGM A MM\n",
}
"""A contour with radius compensation: no take-up may be added beside its blocks."""
ARC = "BEGIN PGM A MM\nTOOL CALL 1 Z S1000\nL X+40 Y+0 Z+20 R0 FMAX\nL Z-1 F500\nCC X+0 Y+0\nC X+28.284 Y+28.286 DR+\nL X+60\nL Z+20 FMAX\nM30\nEND PGM A MM\n"
"""The end lies beside the circle by 0.6 um, the rounding of its words."""
IN_PLANE = "BEGIN PGM A MM\nTOOL CALL 1 Z S1000\nL X+40 Y+0 Z+20 R0 FMAX\nL Z-1 F500\nCC X+0 Y+0\nC X+0 Y+40 DR+\nC X-4 Y+39.799 DR+\nL X+60\nL Z+20 FMAX\nM30\nEND PGM A MM\n"
"""Where an arc stays in its plane, the correction of its start may be wrong for its end."""


@pytest.fixture
def corrected(command):
    """A program corrected for the gantry: its results, its text, and what `verify` finds."""

    def run(name: str, text: str, effects: list, machine: str = "gantry") -> tuple[dict, str, dict]:
        Path(name).write_text(text)
        write_model(model_of(GANTRY, *effects), Path("cal.json"))
        offset = "0" if name.endswith(".h") else "G54"
        options = ("-m", machine, "-c", "cal.json", "--tool-length", "T1=80", "--work-offset", f"{offset}=500,500,300")
        done = command(name, *options, "-o", f"out{name}", "--json", "done.json")
        assert done.status == 0, done.err
        verified = command("verify", name, f"out{name}", *options, "--json", "verified.json")
        assert verified.status == 0, verified.err
        return (
            json.loads(Path("done.json").read_text()),
            Path(f"out{name}").read_text(),
            json.loads(Path("verified.json").read_text()),
        )

    return run


@pytest.mark.parametrize("name", RECTANGLES)
def test_backlash_along_a_move_is_noted(corrected, name):
    done, _, verified = corrected(name, RECTANGLES[name], PLAY)
    note = next(note for note in done["notes"] if "on a part of their paths" in note)
    assert re.search(
        r"\d moves are predicted to be worse than in the input on a part of their paths by at most \d", note
    )
    errors = done["predicted_error_um"]
    assert errors["after"]["max"] < 0.2
    assert errors["anywhere"]["after"] == pytest.approx(verified["anywhere_um"]["after"], abs=0.05)
    assert errors["anywhere"]["after"] > errors["anywhere"]["before"]


def test_the_rounding_of_an_end_is_no_worsening(corrected):
    slope = ErrorMotion("Z", "X", Polynomial((0.0, 5000.0), 1), (0.0, -50.0))
    done, text, verified = corrected("part.h", ARC, [slope])
    assert "CP IPA" in text
    assert done["predicted_error_um"]["after"]["max"] < 0.15
    assert verified["block_ends_um"]["after"]["max"] < 0.15


def test_arcs_in_their_plane_are_not_worse_at_their_ends(corrected):
    text = (machines.FOLDER / "gantry.toml").read_text()
    Path("gantry.toml").write_text(text.replace("[axes.X]", '[control]\nklartext_arcs = "plane"\n\n[axes.X]', 1))
    slope = ErrorMotion("Z", "X", Polynomial((0.0, 5000.0), 1), (0.0, -250.0))
    done, _, verified = corrected("part.h", IN_PLANE, [slope], "gantry.toml")
    assert any("arcs stay in their plane" in note for note in done["notes"])
    assert done["accepted"] == {}
    assert verified["block_ends_um"]["after"]["max"] <= verified["block_ends_um"]["before"]["max"]
