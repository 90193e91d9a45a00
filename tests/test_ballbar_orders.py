"""Circles as shops drive them: other orders, starts, arcs, feeds; and runs of which one name has two circles."""

from io import BytesIO
from itertools import product

import pytest
from support.ballbar_cases import CFRAME, circles_of
from support.tiers import each_once, quick

from calibration.circles.circles import circles_of as circles
from calibration.circles.shares import shares
from calibration.measurement.file import read_measurement
from calibration.measurement.written_file import write_measurement
from calibration.plausibility.checks import sanity
from kinematics.effects import Backlash, LocationError, ReversalSpike, ServoMismatch

CAUSES = {
    "backlash X": Backlash("X", 6.0),
    "reversal-spike Y": ReversalSpike("Y", 8.0, 0.5),
    "squareness X Y": LocationError("C", "Y", 40.0),
    "servo-mismatch X Y": ServoMismatch("X", "Y", 0.4),
}
ORDERS = {
    "ccw twice": [(1000.0, "ccw", 0, 360), (1000.0, "ccw", 0, 360)],
    "ccw, ccw, cw": [(1000.0, "ccw", 0, 360), (1000.0, "ccw", 0, 360), (1000.0, "cw", 0, 360)],
    "cw first": [(3000.0, "cw", 0, 360), (1000.0, "cw", 0, 360), (1000.0, "ccw", 0, 360)],
    "other starts": [(1000.0, "ccw", 37, 360), (1000.0, "cw", 200, 360), (3000.0, "ccw", 90, 360)],
    "half circles": [(1000.0, "ccw", 0, 180), (1000.0, "cw", 0, 180), (3000.0, "ccw", 0, 180)],
    "half circles across": [(1000.0, "ccw", -45, 180), (1000.0, "cw", -45, 180), (3000.0, "cw", -45, 180)],
    "a feed for each direction": [(1000.0, "ccw", 0, 360), (3000.0, "cw", 0, 360)],
    "overshoot": [(1000.0, "ccw", 0, 405), (1000.0, "cw", 0, 405)],
}
"""Feed, direction, first angle and arc of each run."""


def measured_in(tmp_path, order, *effects, name=None, planes=("XY",)):
    """The runs of an order, read from a file without times; name: of all runs."""
    rows, head = [], []
    for k, (feed, way, start, arc) in enumerate(order):
        measured, _ = circles_of(*effects, feeds=(feed,), arc=(start, start + arc), seed=5, step=1.0, planes=planes)
        file = BytesIO()
        write_measurement(measured, file)
        lines = file.getvalue().decode().splitlines()
        head = [line for line in lines if line.startswith("#")]
        names, *data = (line.split(",") for line in lines[len(head) :])
        run, time = names.index("run"), names.index("time_s")
        for row in data:
            if row[run].endswith(f" {way}"):
                row[run] = name or f"run {k}"
                rows.append(",".join(row[:time] + row[time + 1 :]))
        head.append(",".join(names[:time] + names[time + 1 :]))
    path = tmp_path / "circles.csv"
    path.write_text("\n".join([*head, *rows]) + "\n")
    return read_measurement(path, CFRAME)


EVERY = list(product(ORDERS, (*CAUSES, "")))
FEW = EVERY[:: len(CAUSES) + 2]


@pytest.mark.parametrize(("order", "cause"), quick(EVERY, FEW, each_once(ORDERS, (*CAUSES, ""))))
def test_causes_in_other_orders(tmp_path, order, cause):
    """Each cause is named or tied, no other one is, and a machine without errors has none."""
    measured = measured_in(tmp_path, ORDERS[order], *([CAUSES[cause]] if cause else []))
    assert sanity(measured) == []
    listed = [{each.name, *each.tied_with} for each in shares(measured, circles(measured)).causes]
    assert [cause in names for names in listed] == ([True] if cause else [])


def test_two_directions_in_one_run_are_refused(tmp_path):
    order = [(1000.0, "ccw", 0, 360), (1000.0, "cw", 0, 360)]
    (finding,) = [each for each in sanity(measured_in(tmp_path, order, name="a")) if each.fatal]
    assert "run a turns back: give each circle, in each direction, a run of its own" in finding.message
    assert "circles.csv:" in finding.message


def test_two_planes_in_one_run_are_refused(tmp_path):
    order = [(1000.0, "ccw", 0, 90)]
    measured = measured_in(tmp_path, order, name="a", planes=("XY", "ZX"))
    (finding,) = [each for each in sanity(measured) if each.fatal]
    assert "run a leaves its plane" in finding.message
