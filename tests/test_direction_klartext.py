"""Take-ups and arcs in pieces in Klartext."""

import io
import re

import numpy as np
import pytest
from support.backlash_paths import play
from support.klartext_programs import FIVE_AXIS, KLARTEXT, MOVES, first_lines_of, numbered_program
from support.programs import load, model_of

from kinematics.effects import Backlash
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.motion.motions import merged
from postproc.motion.moves import Kind
from postproc.motion.segments import like
from postproc.text.source import Source
from postproc.verification.verify import read_motions, verify

DMU50 = load("dmu50")
WIDTHS = {"X": 20.0, "Y": 40.0, "Z": 12.0}
PLAYED = model_of(DMU50, *(Backlash(axis, width) for axis, width in WIDTHS.items()))


def corrected(source):
    out, setup = io.BytesIO(), make_setup(DMU50, ("0=0,0,150",), zero=True)
    report = Pipeline(Job(source, KLARTEXT, DMU50, PLAYED, setup, travel_check=False)).run(out, lambda _: None)
    return Source("c.h", out.getvalue().decode("latin-1"), out.getvalue()), report


def moves(source):
    return merged(read_motions(source, KLARTEXT, DMU50, make_setup(DMU50, ("0=0,0,150",), zero=True)))


PATH = """3 L X+11 Y+21 Z+51 FMAX
4 L X+20 F500
5 L X+15 F300
6 CC X+15 Y+31
7 C X+15 Y+21 DR+
8 L IX+2 IY+1 F AUTO
9 CR X+20 Y+25 R-4 DR- F200
10 CC IX+3 IY+0
11 C X+23 Y+28 DR-
12 L Z+40 FMAX
13 L Z+41 F100
"""


def test_by_hand():
    result, report = corrected(numbered_program(PATH.replace("\n", "\r\n")))
    lines = [re.sub(r"^\d+ ", "", line.rstrip("\r\n")) for _, line in result.lines()]
    assert all(line.endswith("\r\n") for _, line in result.lines())
    assert lines[4:12] == [
        "L X+11.0100 Y+21.0200 Z+51.0060 FMAX",
        "L X+20.0100 F500",
        "L X+19.9900 F300 ; NCOMP TAKE-UP",
        "L X+14.9900 F300",
        "CC X+15.0100 Y+31.0200",
        "L X+15.0100 ; NCOMP TAKE-UP",
        "C X+25.0100 Y+31.0200 DR+",
        "L X+24.9900 ; NCOMP TAKE-UP",
    ]
    assert "CC X+14.9900 Y+31.0200" in lines
    assert "C X+14.9900 Y+41.0200 DR+ ; NCOMP ARC" in lines
    assert [line for line in lines if line.startswith("CR X") and "DR- ; NCOMP ARC" in line]
    ours = [line for line in lines if "NCOMP" in line or line.startswith("CC ")]
    assert report.added_blocks == len(ours) - 4  # the mark, and the poles of arcs that keep their blocks
    assert report.after.largest < 0.1


def test_the_machine_with_play_follows_the_nominal_path():
    source = numbered_program(PATH)
    nominal, commanded = moves(source), moves(corrected(source)[0])
    matched = like(nominal, commanded)
    shares = np.linspace(0.025, 1.0, 40)
    commands = np.stack([commanded.in_machine(commanded.along(share)) for share in shares], axis=1)
    places = commands.copy()
    for axis, width in WIDTHS.items():
        i = DMU50.index(axis)
        places[:, :, i] = play(commands[:, :, i].ravel(), width * 1e-3).reshape(commands.shape[:2])
    feed = np.flatnonzero(np.isin(matched.kind, (Kind.LINE, Kind.ARC)))
    for k, share in enumerate(shares):
        assert np.abs(places[feed, k] - matched.in_machine(matched.along(share))[feed]).max() < 1e-3
    verdict = verify(nominal, commanded, PLAYED)
    assert verdict.path_before.largest > 20
    assert verdict.path_after.largest < 1


@pytest.mark.parametrize(("name", "lines"), FIVE_AXIS)
def test_real_five_axis_programs(nc_data, name, lines):
    source = first_lines_of(nc_data / "heidenhain" / "five_axis_bc" / name, lines)
    result, report = corrected(source)
    verdict = verify(moves(source), moves(result), PLAYED)
    assert verdict.moves == report.moves == MOVES[lines]
    assert report.added_blocks > 0
    assert verdict.before.largest > 10
    assert verdict.after.rms < 1
