"""The mark that a corrected program carries, so that no correction is ever made twice."""

from __future__ import annotations

import re
from importlib.metadata import version

from kinematics.machine import Machine
from kinematics.model import ErrorModel
from postproc.dialects import Dialect
from postproc.program import Block
from postproc.source import Source

_MARK = re.compile(r"NCOMP \d\S* MACHINE \S+ CALIBRATION ([0-9A-F]+)")
_PLAIN = re.compile(r"[^A-Z0-9_.-]")


def mark_line(dialect: Dialect, machine: Machine, model: ErrorModel, source: Source) -> str:
    """The comment line put into a corrected program; upper case and plain, as the oldest control reads it."""
    name = _PLAIN.sub("_", machine.name.upper())
    text = f"NCOMP {version('ncomp')} MACHINE {name} CALIBRATION {model.id.upper()} PROGRAM {source.hash.upper()}"
    return dialect.comment.format(text) + source.line_end


def mark_in(text: str) -> str | None:
    """The calibration id of a mark in the text of a block, None where there is none."""
    match = _MARK.search(text) if "NCOMP" in text else None
    return match[1] if match else None


def calibration_of(source: Source) -> str | None:
    """The calibration id in the mark of a corrected program, None when it bears none."""
    return next((found for _, text in source.lines() if (found := mark_in(text))), None)


def mark_place(dialect: Dialect, blocks: list[Block]) -> int | None:
    """Index of the block that the mark is put in front of: the first that says something.

    That is behind tape mark, program number, BEGIN PGM and the comments around them. None when there is none yet.
    """
    return next((i for i, b in enumerate(blocks) if b.kind != "blank" and not dialect.is_head(b)), None)
