"""Splines of Siemens programs: the points are corrected, and the curve must follow, whichever way a control makes it.

The curves are those of scipy, through the points that the program gives; what the machine makes of them is worked out
here by hand from its errors.
"""

import re

import numpy as np
import pytest
from scipy import interpolate
from scipy.spatial import cKDTree
from support.programs import load, model_of
from support.siemens_programs import correct, corrected, read

from kinematics.basis import BSpline, Polynomial
from kinematics.effects import Backlash, LocationError
from kinematics.effects.geometric import ErrorMotion
from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc import execution

HEAD = "G17 G90 G71 G94\nG0 X0 Y0 Z100\nG1 F500\n"
ARC = [(10 * np.sin(t) + 3 * t, 10 - 10 * np.cos(t)) for t in np.linspace(0.25, 2.5, 10)]
POINTS = "".join(f"X{x:.4f} Y{y:.4f}\n" for x, y in ARC)
MACHINE = load("gantry")
SQUARE = model_of(MACHINE, LocationError("C", "Y", 100.0), LocationError("B", "Z", 50.0))
BOWED = model_of(MACHINE, ErrorMotion("Y", "X", Polynomial((0.0, 1000.0), 2), (0.0, 100.0, 2000.0), u=(0.0,) * 3))


def points(text):
    """Programmed X Y Z of the spline with its start."""
    motions = read(text)
    return motions.target[: len(ARC) + 1, [MACHINE.index(axis) for axis in "XYZ"]]


def distances(places, curve):
    """Distances of places `(k, 3)` from a curve `(n, 3)`, across it."""
    nearest = np.clip(cKDTree(curve).query(places)[1], 1, len(curve) - 2)
    along = curve[nearest + 1] - curve[nearest - 1]
    along /= np.linalg.norm(along, axis=1)[:, None]
    apart = places - curve[nearest]
    return np.linalg.norm(apart - (apart * along).sum(axis=1)[:, None] * along, axis=1)


def b_spline(p, u):
    """A clamped uniform B-spline of degree 3."""
    knots = np.r_[[0.0] * 3, np.linspace(0.0, 1.0, len(p) - 2), [1.0] * 3]
    return interpolate.BSpline(knots, p, 3)(u)


def b_spline_by_lengths(p, u):
    """A clamped B-spline with weights, and with knots by the distances of its points."""
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))]
    means = [along[i : i + 3].mean() for i in range(1, len(p) - 3)]
    knots = np.r_[[0.0] * 4, means, [along[-1]] * 4] / along[-1]
    weights = np.where(np.arange(len(p)) % 2, 0.5, 2.0)[:, None]
    found = interpolate.BSpline(knots, np.hstack([p * weights, weights]), 3)(u)
    return found[:, :3] / found[:, 3:]


def through(kind, *, uniform):
    """A curve through the points."""

    def curve(p, u):
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))]
        at = np.linspace(0.0, 1.0, len(p)) if uniform else along / along[-1]
        return kind(at, p)(u)

    return curve


def natural(at, p):
    """A cubic spline without curvature at its ends."""
    return interpolate.CubicSpline(at, p, bc_type="natural")


CURVES = [
    ("BSPLINE", b_spline),
    ("BSPLINE", b_spline_by_lengths),
    ("CSPLINE", through(natural, uniform=False)),
    ("CSPLINE", through(interpolate.CubicSpline, uniform=True)),
    ("ASPLINE", through(interpolate.Akima1DInterpolator, uniform=True)),
    ("ASPLINE", through(interpolate.Akima1DInterpolator, uniform=False)),
]


def actual(p, model):
    """Where the machine really is at axis positions X Y Z, mm: the errors above, by hand."""
    moved = p.copy()
    if model is SQUARE:  # small angles: Y leans by 100 urad towards -X, Z by 50 urad towards +X
        moved[:, 0] += -100e-6 * p[:, 1] + 50e-6 * p[:, 2]
    else:
        moved[:, 1] += 0.1 * p[:, 0] / 1000.0 + 2.0 * (p[:, 0] / 1000.0) ** 2
    return moved


@pytest.mark.parametrize("model", [SQUARE, BOWED], ids=["square", "bowed"])
@pytest.mark.parametrize(("name", "curve"), CURVES)
def test_the_curve_follows(name, curve, model):
    text = f"{HEAD}{name}\n{POINTS}G1 X60\nM30\n"
    written = correct(text, model=model)
    u = np.linspace(0.0, 1.0, 2001)
    wanted, reached = curve(points(text), u), actual(curve(points(written), u), model)
    assert distances(actual(wanted, model) - actual(wanted[:1], model) + wanted[:1], wanted).max() > 0.9e-3
    assert distances(reached[10:-10], wanted).max() < 0.3e-3  # a bound of less than 1 um is accepted
    assert correct(text, model=no_errors(MACHINE)) == text


def test_the_points_by_hand():
    """Y leans by 100 urad: at Y10 the tool is 1 um off in -X, so the word is 1 um more."""
    model = model_of(MACHINE, LocationError("C", "Y", 100.0))
    text = f"{HEAD}BSPLINE SD=2\nX1 Y10 PW=2\nX6 Y20 PL=5\nX12 Y10\nG1 X40 Y0\nM30\n"
    written = correct(text, model=model)
    assert re.findall(r"^X.*", written, re.M) == ["X1.0010 Y10 PW=2", "X6.0020 Y20 PL=5", "X12.0010 Y10"]


def test_the_note():
    _, notes = corrected(f"{HEAD}CSPLINE BNAT ENAT\n{POINTS}G1 X60\nM30\n", model=SQUARE)
    assert any("CSPLINE: the points are corrected" in note for note in notes)


KINKED = model_of(
    MACHINE, ErrorMotion("Y", "X", BSpline((-1000.0, 12.0, 1000.0), 1), (0.0, 50000.0, 0.0), u=(0.0,) * 3)
)


@pytest.mark.parametrize("name", ["ASPLINE", "BSPLINE", "CSPLINE"])
def test_a_correction_that_bends_within_the_points(name):
    with pytest.raises(UserError, match=r"test\.mpf:\d+: .*the curve of .SPLINE may be [\d.]+ um from the corrected"):
        correct(f"{HEAD}{name}\nX10 Y20\nX20 Y20\nX40 Y0\nG1 X60\nM30\n", model=KINKED)


def test_a_corner_between_straight_lines_has_no_akima_tangent():
    """Collinear points before and behind a corner: the smallest change turns the tangent from one line to the other."""
    text = f"{HEAD}ASPLINE\nX10\nX20\nX30\nX40 Y10\nX50 Y20\nX60 Y30\nG1 X70\nM30\n"
    with pytest.raises(UserError, match="the curve of ASPLINE may be"):
        correct(text, model=SQUARE)
    assert correct(text.replace("ASPLINE", "BSPLINE"), model=SQUARE)


REFUSED = {
    "ASPLINE X10 PW=2": "belong to B-splines, and ASPLINE is active",
    "X10 SD=2": "belong to B-splines, and none is active",
    "BSPLINE X10 PW=4": "PW=4 is out of its range",
    "BSPLINE X10 SD=4": "SD=4 is out of its range",
    "BSPLINE BNAT X10": "belong to ASPLINE and CSPLINE",
    "G1 ASPLINE X10": "excludes other motions",
    "ASPLINE CSPLINE X10": "excludes other motions",
    "CIP BSPLINE X10": "exclude",
    "G41 D1\nBSPLINE X10": "radius compensation, broken corners",
    "G1 X5 RND=1\nCSPLINE X10": "directly after a chamfer or rounding",
    "CSPLINE X10 RND=1": "radius compensation, broken corners",
    "TRANS X5\nBSPLINE X10 Y10": "starts at a position that the program has not given",
    "BSPLINE X10 Y10\nTRANS Z1\nX20 Y10": "the frame changes inside BSPLINE",
    "BSPLINE X10\nSUPA X0": "machine coordinates need a straight line",
    "BSPLINE X10 Y10\nCT X20 Y0": "needs a move in its plane",
    "BSPLINE X10 I1=2": "has a centre",
    "POLY X5": "POLY begins polynomials",
}


@pytest.mark.parametrize("code", REFUSED)
def test_refused(code):
    with pytest.raises(UserError, match=REFUSED[code]):
        correct(f"{HEAD}{code}\nM30\n", model=SQUARE)


def test_backlash():
    with pytest.raises(UserError, match="axes with backlash reverse along a spline"):
        correct(f"{HEAD}BSPLINE\n{POINTS}G1 X60\nM30\n", model=model_of(MACHINE, Backlash("X", 10.0)))


def test_pieces(monkeypatch):
    """A spline across the pieces in which a program is read."""
    text = f"{HEAD}CSPLINE\n{POINTS}G1 X60\nM30\n"
    whole = correct(text, model=BOWED)
    monkeypatch.setattr(execution, "CHUNK_BLOCKS", 3)
    assert correct(text, model=BOWED) == whole
