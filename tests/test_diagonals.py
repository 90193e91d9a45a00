"""ISO 230-6: diagonals of a box of 300 x 400 x 1200 mm, whose length is 1300 mm, worked out by hand."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from support.command import refusal, succeed

import ncomp
from kinematics.user_error import UserError

BOX = np.array([300.0, 400.0, 1200.0])
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
HEADER = "# machine: gantry\n# instrument: laser-tracker\n# u_range_um: 1\n# u_angle_um: 1\n# stands_on: workpiece\n# target.1: 0 0 0\n"


def measured(path: Path, runs: int = 2, station: str = "s1", **beside: float) -> Path:
    """Each diagonal there and back; the tracker is turned by 30 degrees, and stands somewhere.

    Errors: X is 1.3 mm/m too long, and moves by 0.65 mm/m of Y; backward it is 13 um farther.
    """
    turn = np.array([[np.sqrt(3.0) / 2.0, -0.5, 0.0], [0.5, np.sqrt(3.0) / 2.0, 0.0], [0.0, 0.0, 1.0]])
    rows, before = [], 0.0
    for run, y, z in itertools.product(range(runs), (1.0, -1.0), (1.0, -1.0)):
        for share in (*SHARES, *SHARES[-2::-1]):
            corner = np.array([share, share if y > 0 else 1.0 - share, share if z > 0 else 1.0 - share])
            at = corner * BOX + [beside.get(axis, 0.0) for axis in "XYZ"] * (corner == 0.25)
            error = 1.3e-3 * at[0] + 0.65e-3 * at[1] + 0.013 * (share < before)
            real = at + np.array([error, 0.0, 0.0])
            point = turn @ real + [700.0, -900.0, 250.0]
            rows.append([*at, 1, station if run == 0 else "s1", run + 1, *point])
            before = share
    lines = [",".join(map(str, row)) for row in rows]
    path.write_text(HEADER + "X,Y,Z,target,station,run,x,y,z\n" + "\n".join(lines) + "\n")
    return path


def test_diagonals_by_hand(tmp_path, command):  # noqa: ARG001
    """From X, 390 um * 300 / 1300 = 90 um over the diagonal; from Y 260 um * 300 / 1300 = 60 um, with the sign of Y.

    The inner targets, half of the length, have both directions: 75 and 15 um; backlash 13 um * 300 / 1300 = 3 um.
    """
    done = succeed("iso230", measured(tmp_path / "diagonals.csv"), "--machine", "gantry", "--json", "-", "--quiet")
    answer = json.loads(done.out)
    found = {
        each["axis"]: {name: value["value_um"] for name, value in each["values"].items()} for each in answer["axes"]
    }
    assert list(found) == ["X+Y+Z", "X+Y-Z", "X-Y+Z", "X-Y-Z"]
    for name, values in found.items():
        inner = 75.0 if "+Y" in name else 15.0
        assert values["M"] == pytest.approx(inner, abs=0.1)
        assert values["mean B"] == pytest.approx(-3.0, abs=0.1)
        assert values["E"] == pytest.approx(inner + 3.0, abs=0.1)
        assert values["R forward"] == pytest.approx(0.0, abs=0.1)
    assert answer["diagonals"]["E_d"]["value_um"] == pytest.approx(78.0, abs=0.1)
    assert answer["diagonals"]["B_d"]["value_um"] == pytest.approx(3.0, abs=0.1)
    assert answer["diagonals"]["B_d"]["U_um"] == pytest.approx(2.0 * np.sqrt(1.0 / 2 + 1.0 / 2)), "u 1 um, two runs"
    assert [target["position_mm"] for target in answer["axes"][0]["targets"]] == pytest.approx(
        [325.0 * k for k in range(5)]
    )


def test_the_page_names_the_largest_values_and_the_ends_without_both_directions(tmp_path, command):  # noqa: ARG001
    shown = succeed(
        "iso230", measured(tmp_path / "d.csv"), "--machine", "gantry", "--report", tmp_path / "d.html"
    ).shown
    assert "E_d 78.0" in shown
    assert "X+Y+Z: no forward reading at 0 mm" in shown
    page = (tmp_path / "d.html").read_text()
    assert "body diagonals, ISO 230-6" in page
    # each direction lacks one end: 3/4 of 150 um
    larger = r"E forward 11[23] .m is above E 78\.1 .m, E backward 11[23] .m is above E 78\.1 .m"
    for text in (shown, page):
        assert re.search(larger, " ".join(text.split()))
        assert "(it may be too small: targets with one direction only do not count)" in " ".join(text.split())


def test_rows_that_are_on_no_diagonal_and_several_stations_are_refused(tmp_path, command):  # noqa: ARG001
    for path, reason in (
        (measured(tmp_path / "beside.csv", Y=1.0), "beside.csv:9: the position is on no body diagonal"),
        (measured(tmp_path / "stations.csv", station="s2"), "one target and one station"),
    ):
        assert reason in refusal("iso230", path, "--machine", "gantry")


def test_a_diagonal_has_no_error_motion(tmp_path):
    gantry = ncomp.load_machine("gantry")
    test, *_ = ncomp.iso230(ncomp.read_measurement(measured(tmp_path / "d.csv"), gantry))
    with pytest.raises(UserError, match="a diagonal moves several axes"):
        test.effects(gantry)
