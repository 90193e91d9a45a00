"""Sizes of causes that are functions of position, and the origin and repair by the kind of drive."""

import re

import numpy as np

import machines
from calibration.reports.causes.at_positions import at_positions
from kinematics.basis import Legendre
from kinematics.effects import Backlash, CrossAxis, Cyclic, Reversal

CFRAME = machines.load("cframe")


def shown_of(effect):
    """The sizes of an effect whose parameters are independent."""
    return at_positions(CFRAME, effect, np.diag(np.square(effect.uncertainties)))


def test_a_reversal_is_shown_at_positions_and_not_by_its_coefficients():
    low, high = CFRAME.axes[CFRAME.index("X")].travel
    wear = Reversal("X", "X", Legendre((low, high), 1), (10.0, 4.0), u=(0.5, 0.0))  # 6 um at one end, 14 at the other
    head, *shown = shown_of(wear)
    assert head == "forward minus backward:"
    assert shown[0] == f"6.0 ± 1.0 um at X {low:.4g} mm"
    assert shown[2] == f"10.0 ± 1.0 um at X {(low + high) / 2:.4g} mm"
    assert shown[-1] == f"14.0 ± 1.0 um at X {high:.4g} mm"


def test_a_cross_axis_error_is_shown_at_its_corners():
    sag = CrossAxis("Z", "X", "Y", (0.0, 600.0), (0.0, 400.0), 0, 1, (8.0,), u=(1.0,))
    shown = shown_of(sag)
    assert shown[0] == "-8.0 ± 2.0 um at X 0 mm, Y 0 mm"
    assert shown[-1] == "8.0 ± 2.0 um at X 600 mm, Y 400 mm"
    assert shown_of(Backlash("X", 10.0)) == []


def test_a_rotary_axis_has_no_nut_and_no_screw():
    linear, rotary = Backlash("X", 10.0).workshop, Backlash("A1", 10.0).workshop
    assert "nut" in " ".join(linear)
    for effect in (
        Backlash("A1", 10.0),
        Cyclic("C", "C", 4.0, (3.0,), (0.0,)),
        Reversal("C", "C", Legendre((0, 360), 0), (1.0,)),
    ):
        assert not re.search(r"\b(nut|screw|guide|gib)s?\b", " ".join(effect.workshop)), effect.name
    assert "gear" in " ".join(rotary)
