"""Protocols of measuring cycles and files of ballbar software that are recognised and refused.

Public documentation names the contents of these files, and not their layout: HEIDENHAIN's manuals list the entries of
TCHPR451.TXT (dispersions, backlash, compensation values of each rotary axis), Siemens' those of CYCLE996; Renishaw
describes neither the files of AxiSet nor those of Ballbar. All but the last contain results of the control's own
evaluation, from which the measured positions cannot be found again.
"""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import NamedTuple

_CENTRES = (
    "write the axis positions at which the sphere's centre was found into a measurement file of a touch probe "
    "(# instrument: touch-probe, columns X,Y,Z,...,sphere; docs/measurements.md)"
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


PROTOCOLS = (
    Protocol(
        "a protocol of Siemens' CYCLE996 or CYCLE9960 (measure kinematics)",
        r"CYCLE9960?\b.*",
        r"(?i)CYCLE9960?\b|_OVR\[\d+\]|\$TC_CARR\d+\[|TRAFO5_\w+\[",
        "it lists vectors of the kinematics by the control's evaluation in a layout that no public manual describes",
        f"{_CENTRES}: with WRITE behind CYCLE977 at each rotary position. The vectors themselves, as $TC_CARR or "
        "$MC_TRAFO5_ assignments, are read by ncomp import --format siemens-tcarr or siemens-trafo5",
    ),
    Protocol(
        "a protocol of HEIDENHAIN's cycles 450 to 453 (KinematicsOpt)",
        r"TCHPR45[0-3].*",
        r"(?i)TCHPR45[0-3]|TCH PROBE 45[0-3]|Kinematics\s?Opt|PRESET COMPENSATION"
        r"|MEASURE KINEMATICS|KINEMATIK VERMESSEN",
        "it lists results of the control's evaluation in a layout that no public manual describes, and no positions",
        f"{_CENTRES}: with FN 16 behind a probing cycle at each rotary position",
    ),
    Protocol(
        "a file of Renishaw AxiSet",
        r".*axiset.*",
        r"(?i)\bAxiSet\b",
        "its layout is not public",
        f"{_CENTRES}; AxiSet's macros print these positions",
    ),
    Protocol(
        "a file of Renishaw Ballbar",
        r".*\.(b5r|b20|bbt)",
        r"(?i)\bballbar\b[^\n]*<|<[^\n>]*\bballbar\b|renishaw[^\n]*ballbar|ballbar[^\n]*renishaw",
        "its layout is not public",
        "export angle and deviation as text, and add a header and names of columns (angle_deg,deviation_um,run,feed; "
        "docs/measurements.md#ballbar-angles)",
    ),
    Protocol(
        "a protocol of a control's cycle that measures kinematics",
        r"",
        r"(?i)kinemati[ck]|cin[e\u00e9]mati[cq]",
        "it lists results of the control's evaluation, and no positions",
        _CENTRES,
    ),
)


def refused(head: str, source: str) -> str:
    """The message for a file that is one of PROTOCOLS, with the line that shows it; empty for others."""
    name = PurePath(source).name
    for protocol in PROTOCOLS:
        own = bool(protocol.names) and re.fullmatch(protocol.names, name, re.IGNORECASE) is not None
        lines = enumerate(head.splitlines(), 1)
        shown = next(((k, line.strip()) for k, line in lines if re.search(protocol.texts, line)), None)
        if own or shown:
            where = f"{source}:{shown[0]}: {shown[1][:80]!r}" if shown else source
            return f"{where}: this is {protocol.title}. It is not read: {protocol.why}. Instead, {protocol.instead}"
    return ""
