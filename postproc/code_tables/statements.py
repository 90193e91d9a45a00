"""Statements that write variables besides the one that they name, of all dialects.

One table: `docs/make/configuration.py` writes it into the page on the flow of programs, and
`tests/test_results_of_statements.py` runs every example. What a statement writes is followed, or not known behind it.
"""

from __future__ import annotations

from typing import NamedTuple


class Example(NamedTuple):
    """A block, and what holds behind it."""

    text: str
    writes: str
    """Variables that it writes, with blanks between them: no value from before holds behind it."""
    leaves: str
    """Variables that it leaves."""


class Statement(NamedTuple):
    """A kind of statement, as a row for a reader."""

    dialect: str
    shown: str
    """The statement."""
    sets: str
    """The variables that it sets."""
    afterwards: str
    """What is known of them behind it."""
    examples: tuple[Example, ...]


_REFERENCES = (
    "Siemens functions with results by reference: `CALCDAT`, `INTERSEC`, `CALCPOSI`, `GETACTTD`, `MEASURE`, and all "
    "others that ncomp does not know"
)
STATEMENTS = (
    Statement(
        "siemens", "Siemens `A[1]=SET(10,20,30)`, `R[1]=SET(...)`",
        "the element and those behind it", "followed; an element that the list leaves out is unknown",
        (Example("R[1]=SET(7,8)", "R1 R2", "R3"),),
    ),
    Statement(
        "siemens", "Siemens `A[1]=REP(9)`, `A[1]=REP(9,2)`",
        "the element and those behind it, all or a number of them", "followed",
        (Example("R[1]=REP(9,2)", "R1 R2", "R3"),),
    ),
    Statement(
        "siemens", _REFERENCES,
        "variables among their arguments", "unknown, arrays as a whole",
        (Example("R2=INTERSEC(R1,1)", "R1 R2", ""),),
    ),
    Statement(
        "siemens", "Siemens procedures that pass by `--pass-through`: `READ`, `FILESIZE`, subprograms",
        "variables among their arguments, and R parameters", "unknown; `CYCLE` and a number keeps all",
        (
            Example("READ(R1,R2)", "R1 R2 R3", ""),
            Example("CYCLE83(9,0,1,-5,,2,,1,1)", "", "R1"),
        ),
    ),
    Statement(
        "siemens", "Siemens `CYCLE96x`, `CYCLE97x`, `CYCLE982`, `CYCLE99x` with `--probing beside`",
        "R parameters, variables of the control", "unknown",
        (Example("CYCLE978(0,1,1,1,10,1,0,0,1)", "R1", ""),),
    ),
    Statement(
        "siemens", 'Siemens `TEXT[0]="A"`',
        "one character of a text", "the text is unknown",
        (Example('DEF STRING[4] TEXT="X"\nTEXT[0]="A"', "", "R1"),),
    ),
    Statement(
        "heidenhain", 'Klartext `FN 28: TABREAD Q10 = 6/"X,Y"`',
        "one parameter for each column, from `Q10` on", "unknown",
        (Example('FN 28: TABREAD Q5 = 3 / "X,Y"', "Q5 Q6", "Q7"),),
    ),
    Statement(
        "heidenhain", "Klartext `FN 23`, `FN 24`",
        "three parameters", "unknown",
        (
            Example("FN 23: Q20 = CDATA Q30", "Q20 Q21 Q22", "Q23 Q30"),
            Example("FN 24: Q20 = CDATA Q30", "Q20 Q21 Q22", "Q23 Q30"),
        ),
    ),
    Statement(
        "heidenhain", "Klartext `FN 18`, `TOOL CALL`",
        "one parameter; `Q108`, `Q109` and `Q114`", "known from a tool table, otherwise unknown",
        (
            Example("FN 18: SYSREAD Q5 = ID270 NR1 IDX3", "Q5", "Q6 QL5"),
            Example("FN 19: PLC=+Q5/+0", "", "Q5"),
            Example('FN 27: TABWRITE 5/"R" = Q5', "", "Q5"),
            Example("TOOL CALL 2 Z S200", "Q108 Q109 Q114", "Q110 Q111 Q5"),
        ),
    ),
    Statement(
        "heidenhain", "Klartext `M3`, `M4`, `M5`, `M8`, `M9`, `M13`, `M14`",
        "`Q110`, `Q111`", "unknown",
        (
            Example("L M3", "Q110", "Q109 Q111"),
            Example("L M8", "Q111", "Q110"),
            Example("L Z+9 M13", "Q110 Q111", "Q109"),
        ),
    ),
    Statement(
        "heidenhain", "Klartext functions, cycles and `CALL PGM` that are passed",
        "any parameter", "all unknown",
        (
            Example("TCH PROBE 412 DATUM ~\n Q321=+0", "Q5 Q150 QR3", ""),
            Example("TCH PROBE 0.0 REF. PLANE Q5 X-", "Q5", ""),
        ),
    ),
    Statement(
        "iso", "ISO codes that pass by `--pass-through`, macros that probe",
        "variables that all programs share", "unknown",
        (Example("G65 P9811 Z0.", "#100", "#5"),),
    ),
    Statement(
        "iso", "`G65`, `G66`",
        "`#1` to `#33` of the macro, by its arguments", "followed; those of the caller stay",
        (
            Example("G65 P1000 A7. I8.", "", "#1 #4 #5 #100"),
            Example("G66 P1000 A7.\nY1.\nG67", "", "#1 #5 #100"),
        ),
    ),
    Statement(
        "iso", "FANUC `#3000=1(TEXT)`, `#3006=1(TEXT)`",
        "an alarm, a stop with a message", "never known",
        (
            Example("#3000=1 (STOP)", "#3000", "#5 #100"),
            Example("#3006=1 (STOP)", "#3006", "#5 #100"),
        ),
    ),
    Statement(
        "iso", "FANUC `#3001`, `#3002`",
        "clocks", "never known",
        (
            Example("#3001=0", "#3001", "#5 #100"),
            Example("#3002=0", "#3002", "#5 #100"),
        ),
    ),
    Statement(
        "iso", "FANUC `#3003`, `#3004`",
        "single blocks, feed hold, override", "never known",
        (
            Example("#3003=1", "#3003", "#5 #100"),
            Example("#3004=7", "#3004", "#5 #100"),
        ),
    ),
    Statement(
        "iso", "FANUC `G31`",
        "`#5061` to `#5069`: where the probe touched", "never known",
        (Example("G31 Z1. F50", "#5061 #5063", "#100 #5"),),
    ),
    Statement(
        "iso", "`G10`",
        "offsets and tool data of the control: `#5221` ..., `#2001` ...",
        "the offset is followed, its variables are never known",
        (Example("G10 L2 P1 X0.", "#5221", "#100 #5"),),
    ),
    Statement(
        "iso", "`G92`, `G50`, `G52`",
        "the present coordinates: `#5041` ...; LinuxCNC `#5211` ...",
        "the shift is followed, its variables are never known",
        (
            Example("G92 X0.", "#5211 #5041", "#100 #5"),
            Example("G52 X0.", "#5211 #5041", "#100 #5"),
        ),
    ),
    Statement(
        "iso", "FANUC `POPEN`, `DPRNT`, `BPRNT`, `PCLOS`",
        "nothing", "followed",
        (
            Example("POPEN\nDPRNT[X#5[42]]\nPCLOS", "", "#100 #5"),
            Example("BPRNT[X#5[2]]", "", "#100 #5"),
        ),
    ),
    Statement(
        "iso", "LinuxCNC `M66`, `G38`, `M6`",
        "`#5399`, `#5061` ..., `#5400` ...", "never known",
        (Example("M66 P0 L0", "#5399", "#100 #5"),),
    ),
)  # fmt: skip
"""All statements, in the order of the page."""
