"""Splines of Siemens programs: ASPLINE, BSPLINE and CSPLINE, whose points are corrected.

The control works out the curve from the points; see `postproc/correct/steps/splines.py` for how far the curve follows
them.
"""

from __future__ import annotations

from postproc.control.codes import MOTION
from postproc.motion.moves import Known, Spline
from postproc.siemens.channel import Channel
from postproc.siemens.codes import CORNERS, SPLINE_ENDS, SPLINE_WORDS, SPLINES
from postproc.siemens.polar import POLAR
from postproc.siemens.words import Content, plain_of
from postproc.text.block import Block

REACH = {"ASPLINE": 6, "BSPLINE": 4, "CSPLINE": 8}
"""Number of points on which a piece of the curve depends; of CSPLINE those with more than a hundredth of the effect of
the nearest."""
MOST = {"PW": 3.0, "SD": 3.0}
"""Largest values that the control takes."""


def begin_spline(channel: Channel, block: Block, content: Content) -> None:
    """Take over the kind of spline of a block; Refusal for another motion in the block, or ends without a spline."""
    modal = channel.modal
    begun = SPLINES & content.names.keys()
    if len(begun) > 1 or (begun and not MOTION.keys().isdisjoint(content.g)):
        raise block.refuse("a spline excludes other motions in its block: write one of them")
    if begun and (modal.cornered or modal.rounded):
        raise block.refuse("a spline directly after a chamfer or rounding is not corrected: write G1")
    for name in begun:
        modal.motion, modal.spline, modal.spline_points = 1.0, name, ()
        channel.notes.add(
            f"{name}: the points are corrected, and the control works out the curve from them", block.line
        )
    if modal.spline in ("", "BSPLINE") and not SPLINE_ENDS.isdisjoint(content.names):
        raise block.refuse("conditions at the ends of a spline belong to ASPLINE and CSPLINE: write them there")


def take_point(channel: Channel, block: Block, content: Content, target: list[float]) -> None:
    """Record that the next move ends at a point of a spline in force; Refusal for one that is not followed."""
    modal, recorder = channel.modal, channel.recorder
    name, words = modal.spline, {word: content.other[word] for word in SPLINE_WORDS if word in content.other}
    if not (name or words):
        modal.spline_points = ()
        return
    if words and name != "BSPLINE":
        raise block.refuse(
            f"PW, SD and PL belong to B-splines, and {name or 'none'} is active: write BSPLINE before them"
        )
    for word, index in words.items():
        value = plain_of(block, block.words[index])
        if not 0.0 <= value <= MOST.get(word, value) or (word == "SD" and value not in (2.0, 3.0)):
            raise block.refuse(f"{word}={value:g} is out of its range: write PW from 0 to 3, SD=2 or SD=3, PL above 0")
    other = modal.compensated or modal.rounded or modal.cycle is not None
    if other or not (POLAR | CORNERS).isdisjoint(content.other):
        raise block.refuse(
            f"{name} with radius compensation, broken corners, MCALL or polar coordinates is not corrected: write G1"
        )
    named = [channel.columns.get(block.words[i].address[-1]) for i in content.axes]
    if any(axis is not None and recorder.known[axis] != Known.PROGRAM for axis in named):
        raise block.refuse(f"{name} starts at a position that the program has not given: write its start before it")
    if any(target[axis] != recorder.position[axis] for axis in channel.rotary_axes):
        raise block.refuse(f"rotary axes move along {name}, which is not corrected: write G1")
    start, frame = tuple(recorder.position), recorder.frame
    before = modal.spline_points or (start,)
    if modal.spline_points and (frame != modal.spline_frame or before[-1] != start):
        raise block.refuse(f"the frame changes inside {name}, which is not followed: end the spline before it by G1")
    points = (*before, tuple(target))[-REACH[name] :]
    modal.spline_points, modal.spline_frame = points, frame
    recorder.note("splines", Spline(name, points))
