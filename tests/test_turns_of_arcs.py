"""Arcs of several turns: in pieces where their correction varies, and never worse than they were."""

import math
import random

import numpy as np
import pytest
from hypothesis import strategies as st
from support.backlash_paths import LETTERS, played
from support.programs import correct, load, model_of, random_model, read, shifted
from support.tiers import drawn

from postproc.motion.segments import like
from postproc.verification.verify import verify

GANTRY = load("gantry")
HEAD = "G21 G90 {plane} G94\nG0 X1000 Y1000 Z500\nX1010 Y1010 Z490\n"


def helix(seed):
    """A program with one arc of several turns, by increments of the centre."""
    rng = random.Random(seed)
    plane, sense, turns = rng.choice(list(LETTERS)), rng.choice((2, 3)), rng.randint(2, 5)
    first, second, i, j, normal = LETTERS[plane]
    angle, radius = rng.uniform(0, 2 * math.pi), rng.uniform(1, 60)
    centre = round(-radius * math.cos(angle), 3), round(-radius * math.sin(angle), 3)
    more = rng.choice((0.0, rng.uniform(0.2, 6.0))) * (1 if sense == 3 else -1)
    radius, angle = math.hypot(*centre), math.atan2(-centre[1], -centre[0]) + more
    at = {"X": 1010.0, "Y": 1010.0, "Z": 490.0}
    way = {
        first: centre[0] + radius * math.cos(angle) if more else 0.0,
        second: centre[1] + radius * math.sin(angle) if more else 0.0,
        normal: rng.choice((0.0, -3.0, 20.0)),
    }
    unit, base = rng.choice((1.0, 25.4)), rng.choice(({}, at))
    words = " ".join(f"{axis}{(base.get(axis, 0.0) + step) / unit:.5f}" for axis, step in way.items())
    codes = ("G21" if unit == 1.0 else "G20") + (" G90" if base else " G91")
    block = f"{codes} G{sense} {words} {i}{centre[0] / unit:.5f} {j}{centre[1] / unit:.5f} P{turns} F500\n"
    return HEAD.format(plane=plane) + block + f"G90 G21 G1 {first}1003\n{second}1004\n"


@drawn(
    few=3,
    many=25,
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([0.0, 60.0, 150.0]),
    play=st.sampled_from([0.0, 15.0]),
)
def test_no_arc_of_several_turns_is_worse_than_it_was(seed, size, play):
    text = helix(seed)
    model = model_of(GANTRY, *random_model(GANTRY, seed, size).effects, *played(GANTRY, X=play, Y=play).effects)
    result = correct(text, GANTRY, model)
    nominal, commanded = read(text, GANTRY), read(result.text, GANTRY)
    verdict = verify(nominal, commanded, model)
    assert verdict.after.largest <= 1.6
    assert verdict.path_after.largest <= max(1.0 + 2 * play / 15.0, 0.6 * verdict.path_before.largest)
    matched = like(nominal, commanded)
    for row, arc in commanded.arcs.items():
        ends = [motions.target[row, list(arc.plane[:2])] for motions in (matched, commanded)]
        both = zip(ends, (matched, commanded), strict=True)
        radii = [np.linalg.norm(end - motions.arcs[row].centre) for end, motions in both]
        assert radii[1] == pytest.approx(radii[0], abs=0.05)


def test_by_hand():
    text = HEAD.format(plane="G17") + "G3 I-20 Z480 P2 F500\nG1 X1020\n"
    lines = correct(text, GANTRY, played(GANTRY, X=20.0)).text.splitlines()[4:]
    assert lines == [
        "G1 X1009.9900 F500 (NCOMP TAKE-UP)",
        "G3 X969.9900 I-20 Z487.5000 F500",
        "G1 X970.0100 (NCOMP TAKE-UP)",
        "G3 X1010.0100 Z485.0000 I20.0000 J0.0000 (NCOMP ARC)",
        "G1 X1009.9900 (NCOMP TAKE-UP)",
        "G3 X969.9900 Z482.5000 I-20.0000 J0.0000 (NCOMP ARC)",
        "G1 X970.0100 (NCOMP TAKE-UP)",
        "G3 X1010.0100 Z480.0000 I20.0000 J0.0000 (NCOMP ARC)",
        "G1 X1020.0100",
    ]


def test_a_constant_error_leaves_the_block_whole():
    text = HEAD.format(plane="G17") + "G3 I-20 J0 Z480 P2 F500\n"
    result = correct(text, GANTRY, shifted(GANTRY, X=100.0, Z=50.0))
    assert result.text.splitlines()[4] == "G3 I-20 J0 Z479.9500 P2 F500"
    assert result.report.added_blocks == 0


def test_what_cannot_be_cut_keeps_its_radius():
    """An M function that may run before or behind it: the arc stays whole, and its centre where the ends are."""
    text = HEAD.format(plane="G17") + "G3 X1010 Y1010 I-20 Z480 P2 F500 M9\nG1 X1020\n"
    for model in (played(GANTRY, X=20.0, Y=30.0), random_model(GANTRY, 4)):
        result = correct(text, GANTRY, model)
        commanded = read(result.text, GANTRY)
        (arc,) = (arc for arc in commanded.arcs.values())
        assert math.dist(arc.centre, (1010.0, 1010.0)) == pytest.approx(20.0, abs=0.03)
        assert any("M function" in note for note in result.report.notes)


@pytest.mark.parametrize("seed", range(6))
def test_linuxcnc_runs_the_pieces(linuxcnc, seed):
    text = helix(seed)
    result = correct(text, GANTRY, random_model(GANTRY, seed, 150.0))
    pieces = [move for move in linuxcnc.run(result.text).moves if move.kind == "arc"]
    (whole,) = (move for move in linuxcnc.run(text).moves if move.kind == "arc")
    assert abs(whole.turns) > 1
    assert {move.turns for move in pieces} == {int(math.copysign(1, whole.turns))}
    assert np.linalg.norm(np.subtract(pieces[-1].centre, whole.centre)[:3]) < 1.0 + abs(whole.end[0] * 1e-3)
    assert result.report.split_moves >= 1


def test_the_radius_runs_evenly_from_one_end_to_the_other():
    """The two radii differ within the tolerance of controls: no jump of 15 um at the end of the arc."""
    text = HEAD.format(plane="G17") + "G3 X1010 Y1029.985 I0 J10 F500\n"
    motions = read(text, GANTRY)
    radii = [math.dist(motions.along(share)[-1, :2], (1010.0, 1020.0)) for share in (0.0, 0.5, 0.9999999, 1.0)]
    assert radii == pytest.approx([10.0, 9.9925, 9.985, 9.985], abs=1e-6)
