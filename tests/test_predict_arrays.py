"""Predictions at arrays of states: they are those of a file with the same columns."""

from __future__ import annotations

import numpy as np
import pytest

import ncomp

EFFECTS = (
    "backlash:axis=X,width=12",
    "thermal-scale-sensor:axis=Y,sensor=air,coefficient=11",
    "thermal-drift:component=Z,rate=-20",
    "following-error:axis=X,lag_ms=1.5",
)
POINTS = np.array([[0, 0, 0], [100, 50, 20], [200, 50, 20], [50, 900, 20], [50, 900, 300]])
TIMES = np.array([0.0, 60.0, 120.0, 1800.0, 3600.0])
AIR = np.array([20.0, 20.5, 21.0, 23.0, 25.5])


def model(*effects):
    return ncomp.virtual_machine("gantry", errors="none", effects=effects)


def of_file(folder, columns, points=POINTS, head="", effects=EFFECTS):
    """The deviations at the rows of a file, um."""
    names = ("X", "Y", "Z", *columns)
    rows = [",".join(map(repr, map(float, row))) for row in np.column_stack([points, *columns.values()])]
    (folder / "points.csv").write_text(f"{head}{','.join(names)}\n" + "\n".join(rows) + "\n")
    return ncomp.predict(folder / "points.csv", "gantry", model(*effects)).deviation_um


def test_the_approach_is_that_between_the_rows_unless_it_is_given(tmp_path):
    found = ncomp.predict(POINTS, "gantry", model(EFFECTS[0])).deviation_um
    np.testing.assert_allclose(found, of_file(tmp_path, {}, effects=EFFECTS[:1]))
    assert found[:, 0] == pytest.approx([0.0, -6.0, -6.0, 6.0, 6.0])
    given = ncomp.predict(POINTS, "gantry", model(EFFECTS[0]), approach=[1, 0, 0]).deviation_um
    assert given[:, 0] == pytest.approx([-6.0] * 5)
    each = np.array([[-1, 0, 0], [1, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
    given = ncomp.predict(POINTS, "gantry", model(EFFECTS[0]), approach=each).deviation_um
    directions = {f"dir_{axis}": each[:, i] for i, axis in enumerate("XYZ")}
    np.testing.assert_allclose(given, of_file(tmp_path, directions, effects=EFFECTS[:1]))


def test_time_temperatures_feed_and_tool_are_those_of_a_file(tmp_path):
    feed = np.array([0.0, 1000.0, 1000.0, 2000.0, 2000.0])
    columns = {"time_s": TIMES, "temp_air": AIR, "feed": feed}
    head = "# target.t: 0 0 -120\n"
    found = ncomp.predict(
        POINTS, "gantry", model(*EFFECTS), time=TIMES, temperatures={"air": AIR}, feed=feed, tool=(0, 0, -120)
    ).deviation_um
    np.testing.assert_allclose(found, of_file(tmp_path, columns, head=head), atol=1e-9)
    assert np.abs(found).min(axis=0).max() < np.abs(found).max()


def test_one_temperature_is_that_of_all_rows():
    found = ncomp.predict(POINTS, "gantry", model(EFFECTS[1]), temperatures={"air": 25}).deviation_um
    each = ncomp.predict(POINTS, "gantry", model(EFFECTS[1]), temperatures={"air": np.full(5, 25.0)}).deviation_um
    np.testing.assert_array_equal(found, each)
    assert np.abs(found[:, 1]).max() > 10.0


def test_the_tool_point_may_differ_between_rows():
    points, tools = np.full((2, 5), 50.0), np.array([[0, 0, -100.0], [0, 0, -200.0]])
    found = ncomp.predict(points, "dmu50", tool=tools).deviation_um
    alone = [ncomp.predict(points[:1], "dmu50", tool=tool).deviation_um[0] for tool in tools]
    np.testing.assert_allclose(found, alone)
    assert np.abs(found[0] - found[1]).max() > 0.01
    with pytest.raises(ncomp.UserError, match="tool: expected an array of shape"):
        ncomp.predict(points, "dmu50", tool=tools.T)


def test_what_a_calibration_needs_is_named_in_the_words_of_python():
    for effect, words in ((EFFECTS[1], "needs the temperature 'air'"), (EFFECTS[2], "needs time")):
        with pytest.raises(ncomp.UserError, match=f"{words}.*: state it by approach=, time=, temperatures= or feed="):
            ncomp.predict(POINTS, "gantry", model(effect))


def test_a_position_outside_the_travel_is_a_note():
    notes = ncomp.predict([[1e5, 0, 0]], "gantry", "none").notes
    assert any("leaves its travel" in note for note in notes)


def test_states_belong_to_arrays(tmp_path):
    (tmp_path / "points.csv").write_text("X,Y,Z\n0,0,0\n")
    with pytest.raises(ncomp.UserError, match="time: the points are in a file"):
        ncomp.predict(tmp_path / "points.csv", "gantry", "none", time=[0.0])
