"""Protocols of measuring cycles and files of ballbar software that are recognised and refused.

Public documentation names the contents of these files, and not their layout: HEIDENHAIN's manuals list the entries of
TCHPR451.TXT (dispersions, backlash, compensation values of each rotary axis), Siemens' those of CYCLE996; Renishaw
describes neither the files of AxiSet nor those of Ballbar. All but the last contain results of the control's own
evaluation, from which the measured positions cannot be found again. HEIDENHAIN's other touch probe cycles write a log
named TCHPR and the number of the cycle, or TCHPRAUTO, with a heading such as "Measuring log for touch probe cycle 421"
(TNC7, user's manual of measuring cycles): results at one workpiece, touch probe or tool.
"""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import NamedTuple

_CENTRES = (
    "write the axis positions at which the sphere's centre was found into a measurement file of a touch probe "
    "(# instrument: touch-probe, columns X,Y,Z,...,sphere; docs/measurements/touch_probe.md)"
)


class Protocol(NamedTuple):
    """A file that is known by name or by a text, and not read."""

    title: str
    names: str
    """Pattern of file names."""
    texts: str
    """Pattern of a line that shows it."""
    why: str
    instead: str
    words: tuple[str, ...] = ()
    """Words that show it also where the file ends within one of them."""


PROTOCOLS = (
    Protocol(
        "a protocol of Siemens' CYCLE996 or CYCLE9960 (measure kinematics)",
        r"CYCLE9960?\b.*",
        r"(?i)CYCLE9960?\b|_OVR\[\d+\]|\$TC_CARR\d+\[|TRAFO5_\w+\[",
        "it lists vectors of the kinematics by the control's evaluation in a layout that no public manual describes",
        f"{_CENTRES}: with WRITE behind CYCLE977 at each rotary position. The vectors themselves, as $TC_CARR or "
        "$MC_TRAFO5_ assignments, are read by ncomp import --format siemens-tcarr or siemens-trafo5",
        ("CYCLE996", "$TC_CARR1[", "TRAFO5_BASE_TOOL"),
    ),
    Protocol(
        "a protocol of HEIDENHAIN's cycles 450 to 453 (KinematicsOpt)",
        r"TCHPR45[0-3].*",
        r"(?i)TCHPR45[0-3]|TCH PROBE 45[0-3]|Kinematics\s?Opt|PRESET COMPENSATION"
        r"|MEASURE KINEMATICS|KINEMATIK VERMESSEN",
        "it lists results of the control's evaluation in a layout that no public manual describes, and no positions",
        f"{_CENTRES}: with FN 16 behind a probing cycle at each rotary position",
        ("KinematicsOpt", "Kinematics Opt", "PRESET COMPENSATION", "MEASURE KINEMATICS", "KINEMATIK VERMESSEN"),
    ),
    Protocol(
        "a log of a HEIDENHAIN touch probe cycle",
        r"TCHPR(AUTO|\d+).*",
        r"(?i)\bTCHPR|TCH PROBE 4\d\d|\blog\b.* probe cycle \d+|protokoll.*\b(an)?tast\w*zyklus \d+",
        "it lists results of one cycle at a workpiece, a touch probe or a tool, and no positions of the axes",
        f"{_CENTRES}: with FN 16 behind a probing cycle at each rotary position",
        ("TCH PROBE 4", "Measuring log for touch probe cycle", "Messprotokoll Antastzyklus"),
    ),
    Protocol(
        "a file of Renishaw AxiSet",
        r".*axiset.*",
        r"(?i)\bAxiSet\b",
        "its layout is not public",
        f"{_CENTRES}; AxiSet's macros print these positions",
        ("Renishaw AxiSet",),
    ),
    Protocol(
        "a file of Renishaw Ballbar",
        r".*\.(b5r|b20|bbt)",
        r"(?i)\bballbar\b[^\n]*<|<[^\n>]*\bballbar\b|renishaw[^\n]*ballbar|ballbar[^\n]*renishaw",
        "its layout is not public",
        "export angle and deviation as text, and add a header and names of columns (angle_deg,deviation_um,run,feed; "
        "docs/measurements/ballbar.md#ballbar-angles)",
        ("Renishaw Ballbar", "<Ballbar"),
    ),
    Protocol(
        "a protocol of a control's cycle that measures kinematics",
        r"",
        r"(?i)kinemati[ck]|cin[e\u00e9]mati[cq]",
        "it lists results of the control's evaluation, and no positions",
        _CENTRES,
    ),
)


LEAST_CUT = 6
"""Least number of letters of a word, at the end of a file, that show the word."""


def refused(head: str, source: str) -> str:
    """The message for a file that is one of PROTOCOLS, with the line that shows it; empty for others."""
    name = PurePath(source).name
    lines = head.splitlines()
    for protocol in PROTOCOLS:
        if shown := next(((k, line) for k, line in enumerate(lines, 1) if re.search(protocol.texts, line)), None):
            return _message(protocol, f"{source}:{shown[0]}: {shown[1].strip()[:80]!r}")
        if protocol.names and re.fullmatch(protocol.names, name, re.IGNORECASE):
            return _message(protocol, source)
    for protocol in () if head.endswith(("\n", "\r")) else PROTOCOLS:
        if lines and any(_ends_within(lines[-1], word) for word in protocol.words):
            where = f"{source}:{len(lines)}: {lines[-1].strip()[-80:]!r}"
            return _message(protocol, where) + ". The file ends within this line: it was cut off when it was copied"
    return ""


def _message(protocol: Protocol, where: str) -> str:
    return f"{where}: this is {protocol.title}. It is not read: {protocol.why}. Instead, {protocol.instead}"


def _ends_within(line: str, word: str) -> bool:
    """True for a line that ends with the beginning of a word, where this begins a word of the line."""
    own = line.rstrip().upper()
    beginnings = (word[:k].rstrip().upper() for k in range(LEAST_CUT, len(word)))
    return any(re.search(rf"(?<!\w){re.escape(each)}$", own) for each in beginnings)
