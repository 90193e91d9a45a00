"""Whether a control's family changes the meaning of a code: ncomp reads a short program with it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, cast, get_args, get_type_hints

from kinematics.machine import Control, Machine
from postproc.code_tables.entries import CodeEntry
from postproc.iso.families import refused_by_family

HEADS = {
    "iso": "G21 G17 G90 G94 G54\nT1 M6\nG43 H1\nG0 X0 Y0 Z100 B0 C0\nG1 X1 F100\n",
    "siemens": "G90 G17 G71 G54 G94\nT1 D1 M6\nG0 X0 Y0 Z100 B0 C0\nG1 X1 F100\n",
    "heidenhain": "BEGIN PGM T MM\nTOOL CALL 1 Z S1000\nL X+0 Y+0 Z+100 B+0 C+0 R0 FMAX\n",
}
ENDS = {"iso": "M30\n", "siemens": "M30\n", "heidenhain": "END PGM T MM\n"}
WORDS = (
    *("", "X5.", "X5. Y5.", "X5. Z-5. R2. F100", "X5. Y5. R10.", "P1", "H1", "L2 P1 X5.", "X5. I2. J0."),
    *("X0 Y0 R30.", "X0 Y0 Z0 P2.", "P1 Q1", "Z90.", "P1000"),
)
"""Words that the codes of ISO programs need."""
TRIALS = {
    ",C": "G1 X1. ,C.1 F100.\nG1 Y1.",
    ",R": "G1 X1. ,R.1 F100.\nG1 Y1.",
    ",A": "G1 X1. ,A0. F100.",
    "G53.1": "G68.2 X0 Y0 Z0 I0 J0 K0\nG53.1",
    "G68.2": "G68.2 X0 Y0 Z0 I0 J0 K0\nG53.1",
    "G92.3": "G92 X5.\nG92.2\nG92.3",
    "M97": "M97 P9\nM30\nN9 M99",
}
"""Codes that need others before or behind them."""
CALLS = {"G65", "G66", "G67", "M98", "M99", "M198"}
"""Codes whose trial needs a subprogram in the file."""
HEAD_WITHOUT_LENGTH = HEADS["iso"].replace("G43 H1\n", "")
TRIED_ON = "dmu50"
"""A shipped machine with two rotary axes."""
FAMILIES: tuple[str, ...] = get_args(get_type_hints(Control)["family"])
ANY = FAMILIES[0]
"""No family: what the controls read differently is refused."""


@cache
def machine(family: str = ANY) -> Machine:
    """The machine of the trials, with a family of controls."""
    from machines import load

    found = load(TRIED_ON)
    return replace(found, control=replace(found.control, family=cast(Any, family)))


@cache
def refusal(dialect: str, block: str, family: str = ANY) -> str:
    """The reason why a program with this block is refused; empty where it is accepted."""
    from postproc.control.setup import make_setup
    from postproc.correct.check import check
    from postproc.dialects import find_dialect
    from postproc.text.source import text_source

    head = HEAD_WITHOUT_LENGTH if block.startswith("G43.1") else HEADS[dialect]
    source = text_source(f"{head}{block}\n{ENDS[dialect]}")
    setup = make_setup(machine(family), zero=True)
    found = check(source, find_dialect(dialect, source.name, ""), machine(family), setup, travel_check=False)
    return found.refused[0][2] if found.refused else ""


def families_of(entry: CodeEntry) -> tuple[str, ...]:
    """The families of ISO controls in whose programs a code is accepted; all where none changes its meaning."""
    if entry.dialect != "iso" or entry.verdict == "refused":
        return FAMILIES
    known = FAMILIES
    if entry.letter:
        known = tuple(family for family in FAMILIES if not refused_by_family(family, entry.letter, entry.number))
    if entry.verdict != "followed" or entry.code in CALLS:
        return known
    blocks = [f"{entry.code} {words}".strip() for words in WORDS]
    if entry.code in TRIALS:
        blocks = [TRIALS[entry.code]]
    found = tuple(family for family in FAMILIES if any(not refusal("iso", block, family) for block in blocks))
    return known if ANY in found and entry.letter else found
