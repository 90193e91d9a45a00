"""CIP and CT of Siemens programs: circles that the control calculates; a correction writes G2 or G3 instead."""

import math
import re

import pytest
from support.programs import load, random_model
from support.siemens_programs import correct, read

from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.verification.verify import verify

HEAD = "G17 G90 G71 G94\nG0 X50 Y20 Z150\nG1 X60 F500\n"
HALF = math.sqrt(0.5)
ARCS = {
    # a quarter from (60, 20), heading along X, to (70, 30): about (60, 30), counter-clockwise
    "CT X70 Y30": ((60.0, 30.0), 1),
    "CT X70 Y10": ((60.0, 10.0), -1),
    # behind an arc the tangent is that of its end: at (70, 30) along Y, so about (65, 30) to (60, 30)
    "CT X70 Y30\nCT X60 Y30": ((65.0, 30.0), 1),
    # through the point at 45 degrees of the circle about (60, 30)
    f"CIP X70 Y30 I1=AC({60 + 10 * HALF:.6f}) J1=AC({30 - 10 * HALF:.6f})": ((60.0, 30.0), 1),
    f"CIP X70 Y30 I1={60 - 10 * HALF:.6f} J1={30 + 10 * HALF:.6f}": ((60.0, 30.0), -1),
    f"G91 CIP X10 Y10 I1={10 * HALF:.6f} J1={10 - 10 * HALF:.6f}\nG90": ((60.0, 30.0), 1),
    f"G91 CIP X10 Y10 I1=AC({60 + 10 * HALF:.6f}) J1=AC({30 - 10 * HALF:.6f})\nG90": ((60.0, 30.0), 1),
}


@pytest.mark.parametrize("code", ARCS)
def test_circles_by_hand(code):
    motions = read(f"{HEAD}{code}\nG1 X0\nM30\n")
    arc = list(motions.arcs.values())[-1]
    centre, sense = ARCS[code]
    assert arc.centre == pytest.approx(centre, abs=1e-5)
    assert arc.sense == sense


@pytest.mark.parametrize("code", ARCS)
def test_circles_are_corrected(code):
    text, machine = f"{HEAD}{code}\nG1 X0\nM30\n", load("gantry")
    model = random_model(machine, 8)
    written = correct(text, model=model)
    assert not re.search(r"CIP|CT|[IJ]1=", written)
    verdict = verify(read(text), read(written), model)
    assert verdict.before.largest > 20.0
    assert verdict.after.largest < 0.2
    assert correct(text, model=no_errors(machine)) == text


REFUSED = {
    "CT X70 Y30\nX80": "modal from an earlier block",
    "CT X70": "a straight line",
    "CT X70 Y30 Z140": "leaves the working plane",
    "CIP X70 Y30 I1=65": "takes I1 and J1",
    "CIP X70 Y30 I1=65 J1=22 K1=150": "takes I1 and J1",
    "CIP X80 Y20 I1=70 J1=20": "a straight line",
    "CIP X70 Y30 I1=65 J1=22 CR=5": "a radius",
    "CIP G1 X70 Y30 I1=65 J1=22": "exclude G0 to G3 and each other",
    "CT X70 Y30 I1=65 J1=22": "takes no intermediate point",
    "G1 RND=2 X70\nCT X80 Y30": "directly after a chamfer or rounding",
    "ATRANS X5\nCT X80 Y30": "needs a move in its plane",
}


@pytest.mark.parametrize("code", REFUSED)
def test_refused(code):
    with pytest.raises(UserError, match=REFUSED[code]):
        read(f"{HEAD}{code}\nM30\n")


def test_a_centre_said_as_an_increment():
    text, machine = f"{HEAD}G3 X70 Y30 I=IC(0) J=IC(10)\nM30\n", load("gantry")
    model = random_model(machine, 8)
    written = correct(text, model=model)
    assert re.search(r"I=IC\(-?[\d.]+\) J=IC\([\d.]+\)", written)
    assert next(iter(read(text).arcs.values())).centre == pytest.approx((60.0, 30.0))
    assert verify(read(text), read(written), model).after.largest < 0.2
