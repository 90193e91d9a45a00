"""The mark that a corrected program carries, so that no correction is ever made twice."""

from __future__ import annotations

import re
from importlib.metadata import version

from kinematics.machine import Machine
from kinematics.model import ErrorModel
from postproc.dialects import Dialect
from postproc.program import Block

_MARK = re.compile(r"NCOMP \d\S* MACHINE \S+ CALIBRATION ([0-9A-F]+)")
_PLAIN = re.compile(r"[^A-Z0-9_.-]")


def mark_line(dialect: Dialect, machine: Machine, model: ErrorModel, program_hash: str, end: str) -> str:
    """The comment line put into a corrected program; upper case and plain, as the oldest control reads it."""
    name = _PLAIN.sub("_", machine.name.upper())
    text = f"NCOMP {version('ncomp')} MACHINE {name} CALIBRATION {model.id.upper()} PROGRAM {program_hash.upper()}"
    return dialect.comment.format(text) + end


def mark_in(text: str) -> str | None:
    """The calibration id of a mark in the text of a block, None where there is none."""
    match = _MARK.search(text) if "NCOMP" in text else None
    return match[1] if match else None


def mark_place(dialect: Dialect, blocks: list[Block]) -> int:
    """Index of the block that the mark is put in front of: behind tape mark, program number or BEGIN PGM."""
    place = 0
    for i, block in enumerate(blocks):
        if dialect.is_head(block):
            place = i + 1
        elif block.kind != "blank":
            break
    return place


def line_end(text: str) -> str:
    """The end of a line as it is written there, a line feed where it has none."""
    return text[len(text.rstrip("\r\n")) :] or "\n"
