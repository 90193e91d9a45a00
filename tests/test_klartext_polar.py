"""Klartext moves about poles: against geometry written anew here, and corrected."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.klartext_programs import HEAD, OFFSET, SHIFT, TAIL, correct, read
from support.programs import load, model_of, random_model, shifted
from support.tiers import drawn

from kinematics.effects import Backlash, LocationError
from kinematics.user_error import UserError
from postproc.compensation.correction import pose_errors
from postproc.motion.moves import Kind
from postproc.motion.segments import arc_turned
from postproc.verification.verify import verify

GANTRY = load("gantry")
MODEL = random_model(GANTRY, 11)
ON_ITS_CIRCLE = 2.6
"""um: a CP ends on the circle about its pole, which may pass by the wanted end of nearly full turns."""


def ends(text):
    return read(HEAD + text + TAIL).target[1:, :3]


def judged(text, model=MODEL):
    """The corrected text, what is left at the ends, um, and the verdict along the way."""
    text = HEAD + text + TAIL
    written = correct(text, model=model)
    nominal, commanded = read(text), read(written)
    rows = ~commanded.intermediate
    assert rows.sum() == len(nominal)
    left = pose_errors(GANTRY, model, commanded.machine_target[rows], nominal.machine_target, nominal.tool).point_um
    return written, left[1:], verify(nominal, commanded, model)


def body(written):
    return written.splitlines()[2:-1]


# ---- what is read

POLE = "CC X+45 Y+25\n"
READ = {
    "HEIDENHAIN's own example": (POLE + "LP PR+30 PA+0\nLP PA+60\nLP IPA+60\nLP PA+180\n", [[75, 25], [60, 50.980762], [30, 50.980762], [15, 25]]),
    "radius by increments": (POLE + "L X+75 Y+25\nLP IPR+10\nLP IPR-5 IPA+90\n", [[75, 25], [85, 25], [45, 60]]),
    "full turn": (POLE + "L X+75 Y+25\nCP IPA+360 DR+\nCP IPA-90 DR-\n", [[75, 25], [75, 25], [45, -5]]),
    "to an angle": (POLE + "L X+75 Y+25\nCP PA+90 DR+\nCP PA-180 DR-\n", [[75, 25], [45, 55], [15, 25]]),
    "tangent": ("L X+10 Y+0\nCT X+20 Y+10\nCT X+10 Y+20\n", [[10, 0], [20, 10], [10, 20]]),
    "tangent to a polar end": ("CC X+10 Y+10\nL X+10 Y+0\nCTP PR+10 PA+0\n", [[10, 0], [20, 10]]),
    "a pole where the tool stands": ("L X+5 Y+6\nCC\nL X+15\nCP IPA+90 DR+\n", [[5, 6], [15, 6], [5, 16]]),
    "a pole by increments": ("L X+5 Y+6\nCC IX-5 IY-6\nLP PR+1 PA+90\n", [[5, 6], [0, 1]]),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_polar_coordinates(name):
    text, expected = READ[name]
    np.testing.assert_allclose(ends(text)[:, :2], expected, atol=1e-6)


def test_other_planes():
    """In Y Z angles count from Y towards Z; in Z X from Z towards X."""
    found = ends(
        "L Y+10 Z+0\nCC Y+0 Z+0\nCP IPA+90 DR+\nL X+0 Z+20\nCC Z+0 X+0\nCP IPA+90 DR+\nC X-20 Z+0 DR+\nC X+20 Z+0 DR-\n"
    )
    np.testing.assert_allclose(found[1], [0, 0, 10], atol=1e-9)
    np.testing.assert_allclose(found[3:], [[20, 0, 0], [-20, 0, 0], [20, 0, 0]], atol=1e-9)
    ways = read(HEAD + "L Z+20\nCC Z+0 X+0\nCP IPA+90 DR+\nC X-20 Z+0 DR+\n" + TAIL)
    # from Z over X, and on over -Z to -X
    np.testing.assert_allclose(ways.along(0.5)[2, :3], [20 / math.sqrt(2), 0, 20 / math.sqrt(2)], atol=1e-9)
    np.testing.assert_allclose(ways.along(0.5)[3, :3], [0, 0, -20], atol=1e-9)


@given(
    radius=st.floats(0.1, 200), first=st.floats(-180, 180), turned=st.floats(1, 2000), z=st.floats(-50, 50),
    sense=st.sampled_from([1, -1]),
)  # fmt: skip
def test_helices_wind_as_often_as_they_say(radius, first, turned, z, sense):
    sign = "+" if sense > 0 else "-"
    motions = read(
        f"{HEAD}CC X+3 Y-4\nLP PR+{radius:.4f} PA{first:+.4f}\nCP IPA{sign}{turned:.4f} IZ{z:+.3f} DR{sign}\n{TAIL}"
    )
    radius, first, turned, z = round(radius, 4), round(first, 4), round(turned, 4), round(z, 3)
    for share in (0.0, 0.3, 0.71, 1.0):
        angle = math.radians(first + sense * share * turned)
        wanted = [3 + radius * math.cos(angle), -4 + radius * math.sin(angle), share * z]
        np.testing.assert_allclose(motions.along(share)[2, :3], wanted, atol=1e-6)
    assert arc_turned(motions, 2) == pytest.approx(sense * math.radians(turned), abs=1e-9)


@given(
    st.tuples(st.floats(-50, 50), st.floats(-50, 50)), st.floats(0, 6.28), st.tuples(st.floats(-80, 80), st.floats(-80, 80))
)  # fmt: skip
def test_a_tangent_arc_leaves_as_the_line_arrives(start, heading, way):
    start, way = np.round(start, 3), np.round(way, 3)
    before = np.round(start - 20 * np.array([math.cos(heading), math.sin(heading)]), 3)
    direction = (start - before) / np.linalg.norm(start - before)
    across = direction[0] * way[1] - direction[1] * way[0]
    if abs(across) < 0.5 or np.linalg.norm(way) < 1.0:
        return
    end = start + way
    text = "".join(f"{code} X{x:+.3f} Y{y:+.3f}\n" for code, (x, y) in (("L", before), ("L", start), ("CT", end)))
    motions = read(HEAD + text + TAIL)
    arc = motions.arcs[3]
    centre = np.array(arc.centre)
    assert abs((start - centre) @ direction) < 1e-6 * np.linalg.norm(start - centre)
    assert np.linalg.norm(start - centre) == pytest.approx(np.linalg.norm(end - centre), rel=1e-9)
    begins = motions.along(1e-4)[3, :2] - start
    assert begins @ direction > 0


# ---- what is written

WRITTEN = {
    "lines": POLE + "LP PR+30 PA+0 FMAX\nLP PA+60 F500\nLP IPA+60 Z+3\nLP PA+180\nLP IPR+5,5\n",
    "arcs": POLE + "LP PR+30 PA+10 F500\nCP IPA+100 DR+\nCP PA-30 DR- F200\nCP IPA+360 DR+\nL X+0 Y+0\n",
    "a helix": POLE + "LP PR+30 PA+10 F500\nCP IPA-1000 IZ-20 DR-\nCP IPA+720 Z+1 DR+\nL X+0\n",
    "lines behind arcs": POLE + "LP PR+30 PA+10 F500\nCP IPA+100 DR+\nLP IPA+20\nLP PR+40\nCC IX+5 IY+5\nLP PR+9 PA+9\nLP IPA+9\n",
    "tangents": "L X+30 Y+0 F500\nCT X+60 Y+30\nCC X+0 Y+30\nCTP PR+61 PA+90\nCT X+30\n",
    "other planes": "CC Z+0 X+40\nLP PR+30 PA-90 F500\nCP IPA+50 DR+\nCP IPA-400 IY+3 DR-\nCC Y+0 Z+0\nLP PR+20 PA+3\nCP PA+90 DR+\n",
    "inches": "CC X+1 Y+0\nLP PR+1,5 PA+30 F50\nCP IPA+100 DR+\nCC IX+1 IY+1\nCP IPA+400 IZ+1 DR+\n",
}  # fmt: skip


@pytest.mark.parametrize("name", WRITTEN)
def test_corrected(name):
    text = WRITTEN[name]
    if name == "inches":
        text = text.replace("F50\n", "F50\n", 1)
    written, left, verdict = judged(text)
    assert verdict.before.largest > 30.0
    assert left.max() < ON_ITS_CIRCLE, written
    assert [line.split()[0] for line in body(written) if not line.startswith("CC")] == [
        line.split()[0].replace("CTP", "CP").replace("CT", "CP")
        for line in text.splitlines()
        if not line.startswith("CC")
    ]
    assert correct(HEAD + text + TAIL) == HEAD + text + TAIL


@pytest.mark.parametrize("name", [name for name in WRITTEN if name != "inches"])
def test_with_a_constant_error_every_point_goes_by_it(name):
    text = HEAD + WRITTEN[name] + TAIL
    before, after = read(text), read(correct(text, model=shifted(GANTRY, **OFFSET)))
    np.testing.assert_allclose(after.target - before.target, np.broadcast_to(SHIFT, before.target.shape), atol=1.5e-4)
    for row, arc in before.arcs.items():
        moved = np.subtract(after.arcs[row].centre, arc.centre)
        np.testing.assert_allclose(moved, np.array(SHIFT)[list(arc.plane[:2])], atol=3e-4)
        assert arc_turned(after, row) == pytest.approx(arc_turned(before, row), abs=1e-4)


def test_words_keep_their_kind():
    text = POLE + "LP PR+30 PA+10,5 F500\nCP IPA+100 DR+ R0\n"
    lines = body(correct(HEAD + text + TAIL, model=shifted(GANTRY, **OFFSET)))
    assert lines[0] == "CC X+45 Y+25"
    assert re.fullmatch(r"LP PR\+29,9978 PA\+10,50\d* F500", lines[1]), lines
    assert lines[2] == "CC X+44,9970 Y+25,0042"
    assert re.fullmatch(r"CP IPA\+100(,000\d*)? DR\+ R0", lines[3]), lines


def test_formulas_take_the_correction_by_a_parameter():
    text = "Q1 = 30\nQ2 = 10\n" + POLE + "LP PR+Q1 PA+Q2 F500\n"
    written = correct(HEAD + text + TAIL, model=shifted(GANTRY, **OFFSET))
    assert "FN 1: QL463 =+Q1 + -0.0022" in written
    assert re.search(r"LP PR\+QL463 PA\+QL464 F500", written), written


def test_ctp_by_parameters_is_refused():
    text = "Q1 = 10\nCC X+10 Y+10\nL X+10 Y+0\nCTP PR+Q1 PA+0\n"
    with pytest.raises(UserError, match="CTP with parameters cannot be corrected"):
        correct(HEAD + text + TAIL, model=MODEL)


def test_pieces_of_a_helix_are_said_by_angles():
    """An axis with backlash turns back in it: C does not go up, CP does."""
    model = model_of(GANTRY, Backlash("X", 20.0))
    text = POLE + "L X+80 Y+25 Z+10 F500\nL X+75\nCP IPA+500 IZ-20 DR+\n"
    written = correct(HEAD + text + TAIL, model=model)
    pieces = [line for line in written.splitlines() if "NCOMP ARC" in line]
    assert pieces
    assert all(line.startswith("CP IPA") and "Z" in line for line in pieces), pieces
    nominal, commanded = read(HEAD + text + TAIL), read(written)
    row = next(iter(nominal.arcs))
    turned = sum(arc_turned(commanded, i) for i in commanded.arcs)
    assert turned == pytest.approx(arc_turned(nominal, row), abs=1e-3)


# ---- approaches, patterns


def test_approach_and_departure():
    text = (
        "L X-20 Y+20 FMAX\nAPPR LT X+20 Y+20 LEN15 RR F300\nL X+40 Y+30\nDEP LT LEN12 F900\nL X-20 Y+0 Z+9 R0 FMAX\n"
        "APPR LCT X+10 Y+5 R10 RL\nL X+30\nDEP LCT X+0 Y+0 R5\nL Z+50 FMAX\n"
    )
    motions = read(HEAD + text + TAIL)
    assert motions.target[1:, :2].tolist()[1:3] == [[20, 20], [40, 30]]
    assert motions.kind.tolist()[2] == Kind.RAPID
    assert body(correct(HEAD + text + TAIL, model=shifted(GANTRY, **OFFSET))) == [
        "L X-20.0030 Y+20.0042 FMAX", "APPR LT X+19.9970 Y+20.0042 LEN15 RR F300", "L X+39.9970 Y+30.0042",
        "DEP LT LEN12 F900", "L X-20.0030 Y+0.0042 Z+8.9945 R0 FMAX", "APPR LCT X+9.9970 Y+5.0042 R10 RL",
        "L X+29.9970", "DEP LCT X-0.0030 Y+0.0042 R5", "L Z+49.9945 FMAX",
    ]  # fmt: skip


DRILL = "CYCL DEF 200 DRILLING ~\n Q200=+2 ~\n Q201=-20 ~\n Q203=+5 ~\n Q204=+50\n"
LINES = (
    "CYCL DEF 221 PATTERN ~\n Q225=+10 ~\n Q226=+20 ~\n Q237=+30 ~\n Q238=+40 ~\n Q242=+3 ~\n Q243=+2 ~\n Q224=+90 ~\n"
    " Q200=+2 ~\n Q203=+5 ~\n Q204=+50 ~\n Q301=+1\n"
)
CIRCLE = (
    "CYCL DEF 220 PATTERN ~\n Q216=+50 ~\n Q217=+60 ~\n Q244=+40 ~\n Q245=+0 ~\n Q246=+360 ~\n Q247=+0 ~\n Q241=+4 ~\n"
    " Q200=+2 ~\n Q203=+5 ~\n Q204=+50 ~\n Q301=+1\n"
)


def test_holes_of_patterns():
    found = ends(DRILL + LINES)[:, :2]
    np.testing.assert_allclose(found, [[10, 20], [10, 50], [10, 80], [-30, 80], [-30, 50], [-30, 20]], atol=1e-9)
    found = ends(DRILL + CIRCLE)[:, :2]
    np.testing.assert_allclose(found, [[50, 60], [70, 60], [50, 80], [30, 60], [50, 40]], atol=1e-9)


@pytest.mark.parametrize(("pattern", "words"), [(LINES, ("Q225=+9.9970", "Q226=+20.0042")), (CIRCLE, ("Q216=+49.9970", "Q217=+60.0042"))])  # fmt: skip
def test_a_pattern_goes_as_a_whole(pattern, words):
    text = HEAD + DRILL + pattern + TAIL
    written = correct(text, model=shifted(GANTRY, **OFFSET), tolerance_um=1.0)
    for word in words:
        assert word in written
    assert written.count("CYCL DEF 22") == 1
    moved = read(written).target - read(text).target
    np.testing.assert_allclose(moved[:, :2], np.broadcast_to(SHIFT[:2], moved[:, :2].shape), atol=1e-9)


LEANING = model_of(GANTRY, LocationError("C", "Y", 100.0))
"""Y leans by 100 urad towards -X: the word of X is 0.1 um more per mm of Y."""
ONE = (
    "CYCL DEF 221 {} ~", "Q225={} ~", "Q226={} ~", "Q237=+0 ~", "Q238=+0 ~", "Q242=+1 ~", "Q243=+1 ~", "Q224=+0 ~",
    "Q200=+2 ~", "Q203=+5 ~", "Q204=+50 ~", "Q301=+1",
)  # fmt: skip


def holes(name, *places):
    """The lines of patterns with one hole each."""
    return [line.format(value) for x, y in places for line, value in zip(ONE, (name, x, y, *[""] * 9), strict=True)]


def test_lines_of_holes_that_want_different_corrections():
    text = HEAD + DRILL + LINES + TAIL
    written = correct(text, model=LEANING, tolerance_um=1.0)
    lines = [line.strip() for line in body(written)]
    first = lines.index("CYCL DEF 221 PATTERN ~")
    assert lines[first : first + 12] == [
        "CYCL DEF 221 PATTERN ~", "Q225=+10.0020 ~", "Q226=+20 ~", "Q237=+30 ~", "Q238=+40 ~", "Q242=+1 ~", "Q243=+1 ~",
        "Q224=+90 ~", "Q200=+2 ~", "Q203=+5 ~", "Q204=+50 ~", "Q301=+1",
    ]  # fmt: skip
    assert lines[first + 12 : first + 12 + 60] == holes(
        "PATTERN", ("+10.0050", "+50.0000"), ("+10.0080", "+80.0000"), ("-29.9920", "+80.0000"),
        ("-29.9950", "+50.0000"), ("-29.9980", "+20.0000"),
    )  # fmt: skip
    assert verify(read(text), read(written), LEANING).after.largest < 0.2


def test_a_circle_of_holes_that_want_different_corrections():
    text = HEAD + DRILL + CIRCLE + TAIL
    written = correct(text, model=LEANING, tolerance_um=1.0)
    lines = [line.strip() for line in body(written)]
    first = lines.index("CYCL DEF 220 PATTERN ~")
    # holes at (70, 60), (50, 80), (30, 60), (50, 40); the first keeps its circle, whose centre moves with it
    assert lines[first : first + 8] == [
        "CYCL DEF 220 PATTERN ~", "Q216=+50.0060 ~", "Q217=+60 ~", "Q244=+40.0000 ~", "Q245=+0.0000 ~", "Q246=+360 ~",
        "Q247=+0 ~", "Q241=+1 ~",
    ]  # fmt: skip
    assert lines[first + 12 : first + 12 + 36] == holes(
        "CARTESIAN PATTERN", ("+50.0080", "+80.0000"), ("+30.0060", "+60.0000"), ("+50.0040", "+40.0000")
    )
    assert verify(read(text), read(written), LEANING).after.largest < 0.2


def test_a_pattern_by_formulas():
    lines = DRILL + LINES.replace("Q225=+10", "Q225=+Q80").replace("Q242=+3", "Q242=+Q81").replace(
        "Q203=+5", "Q203=+Q82"
    )
    text = HEAD + "Q80 = 10\nQ81 = 3\nQ82 = 5\n" + lines + TAIL
    written = correct(text, model=LEANING, tolerance_um=1.0)
    assert verify(read(text), read(written), LEANING).after.largest < 0.2
    assert written.count("Q203=+Q82") == 6
    assert written.count("Q242=+1") == 6


def test_a_called_position_is_corrected():
    text = DRILL + "CYCL CALL POS X+10 Y+20 Z+0 FMAX M13\nCYCL CALL POS X+30 Y+20 Z+3\n"
    motions = read(HEAD + text + TAIL)
    assert motions.target[1:, :3].tolist() == [[10, 20, 0], [30, 20, 3]]
    assert motions.start[2, 2] == 55
    assert body(correct(HEAD + text + TAIL, model=shifted(GANTRY, **OFFSET)))[-2:] == [
        "CYCL CALL POS X+9.9970 Y+20.0042 Z-0.0055 FMAX M13", "CYCL CALL POS X+29.9970 Y+20.0042 Z+2.9945",
    ]  # fmt: skip


@drawn(few=8, many=20, data=st.data())
def test_generated_programs_are_corrected(data):
    lines = [POLE.strip(), "LP PR+40 PA+0 F500"]
    for _ in range(data.draw(st.integers(1, 8))):
        kind = data.draw(st.sampled_from(["LP", "LPI", "CP", "CPI", "CT", "CC", "L"]))
        value = data.draw(st.integers(20, 300))
        sign = data.draw(st.sampled_from("+-"))
        match kind:
            case "LP":
                lines.append(f"LP PR+{value / 4} PA{sign}{value}")
            case "LPI":
                lines.append(f"LP IPA{sign}{value / 3:.3f} Z{sign}{value / 50}")
            case "CP":
                lines += [f"LP PR+20.5 PA{sign}{value}", f"CP PA{sign}{value + 77} DR{sign}"]
            case "CPI":
                # not near a whole turn: a circle cannot lead to two places side by side that want other corrections
                turned = data.draw(st.sampled_from([75, 131.5, 250, 290, 435, 610, 1000]))
                lines.append(f"CP IPA{sign}{turned} IZ{sign}{value / 100} DR{sign}")
            case "CT":
                lines += [f"L X{sign}{value} Y+5", f"L IX+{value / 10} Y+5", f"CT IX+7 Y{sign}{value / 7 + 20:.3f}"]
            case "CC":
                lines += [f"L X{sign}{value / 3:.3f} Y-90.5", "CC IX+11 IY+7"]
            case _:
                lines.append(f"L X{sign}{value / 3:.3f} IY+3.5")
    text = "\n".join(lines) + "\n"
    written, left, _ = judged(text)
    assert left.max() < ON_ITS_CIRCLE, written


FROM_ANYWHERE = "BEGIN PGM A MM\nCC X+10 Y+20\nLP PR+50 PA+30 FMAX\nL Z+20\nLP PA+60 F500\nEND PGM A MM\n"


def test_both_polar_coordinates_need_no_place_before():
    nominal, commanded = read(FROM_ANYWHERE), read(correct(FROM_ANYWHERE, model=MODEL))
    np.testing.assert_allclose(nominal.target[2, :2], [35, 20 + 50 * math.sin(math.radians(60))], atol=1e-9)
    rows = ~commanded.intermediate
    left = pose_errors(GANTRY, MODEL, commanded.machine_target[rows], nominal.machine_target, nominal.tool).point_um
    assert left[1:].max() < 0.2


@pytest.mark.parametrize("words", ["LP PR+50", "LP PA+30", "LP PR+50 IPA+10", "CP PA+30 DR+"])
def test_others_do(words):
    with pytest.raises(UserError, match="count from a position that the program has not given"):
        correct(f"BEGIN PGM A MM\nCC X+10 Y+20\n{words}\nEND PGM A MM\n")
