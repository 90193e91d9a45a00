"""The NC program of a path that is measured on the fly: straight moves at one feed, standing at both ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.generate import Manner, assumptions, speech_of, words_of

STANDS_S = 3.0
"""At the start, where recording begins, and at the end."""


def path_program(machine: Machine, corners: Array, manner: Manner, dialect: str, title: str) -> Iterator[str]:
    """The lines of the program along corners `(m, axes)`, mm and degrees; UserError for what the dialect can't say."""
    manner = replace(manner, dwell_s=STANDS_S)
    speech = speech_of(machine, manner, dialect)
    offset = [(manner.offset[1] if manner.offset else {}).get(name, 0.0) for name in machine.names]
    yield from speech.head(
        [
            f"{title} - MACHINE {machine.name} - {len(corners)} CORNERS - FEED {manner.feed:g} MM/MIN",
            "RUN IT FROM START TO END ONCE FOR EACH TARGET - STATION AND FEED - RECORDING ALL THE TIME",
            "SPINDLE OFF - MOVES ARE STRAIGHT LINES FROM CORNER TO CORNER: TRY IT AT LOW OVERRIDE",
            *assumptions(dialect, manner),
        ]
    )
    yield from speech.stop("M0", "GO ON WHEN THE WAY TO THE FIRST CORNER IS FREE")
    yield speech.move(words_of(machine, corners[0] - offset), "START")
    yield from speech.stop("M0", "START RECORDING AND GO ON")
    yield from speech.dwell()
    for number, corner in enumerate(corners[1:], start=2):
        yield speech.move(words_of(machine, corner - offset), f"C{number}")
    yield from speech.dwell()
    yield from speech.end()
