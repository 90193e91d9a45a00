"""Arcs that are none in the other coordinates: they become straight lines, from point to point of the circle."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.correct.tcp.path import shifts_only, turns
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind
from postproc.motion.segments import arc_turned
from postproc.siemens.codes import CALCULATED_ARCS, MIDDLES
from postproc.text.block import Block, Edit
from postproc.write.added_blocks import ARCS, TURN_WORDS
from postproc.write.editors import Rewrite

CIRCLE = TURN_WORDS | {"I", "J", "K", "R", "CR", *MIDDLES}
"""ISO and Siemens: addresses of the centre, the radius, the intermediate point and the turns of an arc."""
SENSES = frozenset(("DR+", "DR-"))
"""Klartext: senses of rotation."""
POLAR = frozenset(("PA", "IPA", "PR", "IPR"))
"""Klartext: addresses of the polar end of an arc."""
_HEAD = re.compile(r"\b(CTP|CT|CP|CR|C)\b", re.IGNORECASE)


def bent_arcs(motions: Motions, rows: NDArrayBool) -> list[int]:
    """The arcs among rows `(n,)` that are none in the other coordinates.

    A tangential arc is none either behind such an arc, because a straight line has another direction there.
    """
    arcs = sorted(row for row in motions.arcs if rows[row])
    turned: NDArrayBool = np.asarray(turns(motions).any(axis=1))
    found: list[int] = []
    for row, same in zip(arcs, shifts_only(motions, arcs), strict=True):
        follows = motions.arcs[row].form == "tangent" and found[-1:] == [row - 1]
        if not same or turned[row] or follows:
            found.append(row)
    return found


def bends(motions: Motions, arcs: Sequence[int]) -> Array:
    """Degrees `(n,)` by which rotary axes and these arcs turn in each move."""
    found = turns(motions).sum(axis=1)
    for row in arcs:
        found[row] += abs(np.rad2deg(arc_turned(motions, row)))
    return np.asarray(found)


def straightened(motions: Motions, rows: NDArrayBool) -> Motions:
    """The moves, the arcs among rows `(n,)` as lines between their ends."""
    if not rows.any():
        return motions
    kind, blocks = np.where(rows, Kind.LINE, motions.kind), set(motions.block[rows].tolist())
    arcs = {row: arc for row, arc in motions.arcs.items() if not rows[row]}
    polar_ends = {index: end for index, end in motions.polar_ends.items() if index not in blocks}
    return replace(motions, kind=kind, arcs=arcs, polar_ends=polar_ends)


def write_straight(index: int, block: Block, arc: Arc, rewrite: Rewrite) -> None:
    """Take the words of a circle out of a block, and write G1 in place of G2 or G3, or L in place of C."""
    rewrite.straight.add(index)
    edits = rewrite.edits.setdefault(index, [])
    if block.kind == "words":
        rewrite.cut[index] = [i for i, word in enumerate(block.words) if word.address in CIRCLE]
        codes = [word for word in block.words if word.address == "G" and word.value in ARCS]
        edits += [Edit(word.start, word.end, "1") for word in codes]
        edits += [Edit(word.at, word.end, "G1") for word in block.words if word.address in CALCULATED_ARCS]
        return
    polar = [i for i, word in enumerate(block.words) if word.address in POLAR]
    radius = [arc.words[0]] if arc.form == "radius" and arc.words[0] is not None else []
    rewrite.cut[index] = [i for i, word in enumerate(block.words) if word.address in SENSES] + polar + radius
    if polar:
        rewrite.spelled.add(index)
    if head := _HEAD.search(block.text):
        edits.append(Edit(head.start(), head.end(), "L"))
