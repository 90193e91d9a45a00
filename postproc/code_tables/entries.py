"""One entry for each code of a dialect: whether ncomp follows it, passes it or refuses it, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Literal

import msgspec

from postproc.control import codes as shared
from postproc.heidenhain import codes as heidenhain
from postproc.iso import codes as iso
from postproc.iso.families import IN_MACHINE_FRAME, NORMAL_END, STORED
from postproc.siemens import codes as siemens

Verdict = Literal["followed", "passes", "noted", "refused"]
VERDICTS: dict[Verdict, str] = {
    "followed": "followed",
    "passes": "passes unchanged",
    "noted": "passes with a note",
    "refused": "refused",
}
PASSES = "does not change the programmed path"
CONTROLS = {
    "iso": "FANUC series 30i, 31i, 32i and 0i-F (milling), HAAS NGC, LinuxCNC 2.9, grbl 1.1, grblHAL, Mach3",
    "siemens": "SINUMERIK 840D sl and 828D, software 4",
    "heidenhain": "iTNC 530, TNC 640 and TNC7, Klartext",
}
"""The controls whose manuals, or interpreter, the tables follow."""
ANY_OTHER = {
    "iso": (
        "Any other G code is refused as not known. An M function that is not in these lists is taken to move nothing "
        "and to set no variable, and a note names it."
    ),
    "siemens": "Any other G code, cycle or word is refused as not known.",
    "heidenhain": (
        "Any other cycle, function or block is refused as not known. An M function that is not in these lists is taken "
        "to move nothing and to set no variable, and a note names it."
    ),
}
"""What happens to a code without an entry."""


class CodeEntry(msgspec.Struct, frozen=True):
    """A code with its meaning to ncomp."""

    dialect: str
    code: str
    """As a reader writes it: `G43.4`, `CYCLE81`, `cycle 200`, `FN 18`."""
    verdict: Verdict
    meaning: str
    """What the code does, or the reason of its refusal."""

    @property
    def letter(self) -> str:
        """`G` or `M` of a code with a number; empty for others."""
        return self.code[0] if self.code[0] in "GM" and self.code[1:2].isdigit() else ""

    @property
    def number(self) -> float:
        """The number of a code with `letter`."""
        return float(self.code[1:])


ISO_FOLLOWED: dict[str, Iterable[float]] = {
    "moves: rapid, straight, arcs": shared.MOTION,
    "planes": shared.PLANES,
    "inch, mm": iso.UNITS,
    "absolute, incremental": shared.DISTANCES,
    "centres of arcs, absolute or incremental": iso.CENTRE_DISTANCES,
    "feed: inverse time, per minute, per revolution": iso.FEED_MODES,
    "work offsets; `G54.1 P`, `G154 P`": iso.OFFSET_CODES,
    "tool length, tool centre point": iso.LENGTH_CODES,
    "drilling cycles, and their end": (*iso.CYCLES, iso.CYCLE_END),
    "return to the initial level, to R": (iso.RETURN_TO_LEVEL, iso.RETURN_TO_R),
    "radius compensation: the points of the contour are corrected": (*iso.COMPENSATION, iso.COMPENSATION_END),
    "polar coordinates": (iso.POLAR, iso.POLAR_END),
    "data: offsets and lengths that the program sets": (iso.DATA, iso.GIVEN_LENGTH),
    "shifts and presets": (iso.LOCAL, iso.PRESET, iso.PRESET_END, iso.PRESET_OFF, iso.PRESET_ON),
    "scale, mirror, rotation, tilted plane": (*iso.TURNS, iso.SCALE_END, iso.MIRROR_END, iso.ROTATION_END, iso.UPRIGHT),
    "reference positions and machine coordinates: the move stays": (28.0, 30.0, 53.0, *IN_MACHINE_FRAME),
    "stores the present position (LinuxCNC, grbl); elsewhere the positions are unknown after it": STORED,
    "end of the normal direction control": (NORMAL_END,),
    "subprograms and macros, in the same file or in files beside it": (65.0, 66.0, 67.0),
    "fine boring (FANUC); a thread on LinuxCNC": (iso.FINE_BORING,),
}
SIEMENS_FOLLOWED: dict[str, Iterable[float]] = {
    "moves: rapid, straight, arcs": shared.MOTION,
    "planes": shared.PLANES,
    "inch, mm": siemens.UNITS,
    "absolute, incremental": shared.DISTANCES,
    "feed": siemens.FEED_TYPES,
    "work offsets": siemens.WORK_OFFSETS,
    "machine coordinates, reference positions: the move stays": siemens.MACHINE | siemens.REFERENCE,
    "limits": siemens.LIMITS,
    "poles": siemens.POLES,
    "radius compensation": (*siemens.CUTTER_RADIUS, siemens.CUTTER_RADIUS_END),
}
SIEMENS_WORDS: dict[str, Iterable[str]] = {
    "polar coordinates": ("AP=", "RP="),
    "programmable frames": siemens.FRAME_NAMES - siemens.SPATIAL_NAMES,
    "arcs that the control calculates": siemens.CALCULATED_ARCS,
    "splines: the points are corrected": siemens.SPLINES,
    "ends of splines": siemens.SPLINE_ENDS,
    "weight, degree and intervals of a B-spline": frozenset(f"{word}=" for word in siemens.SPLINE_WORDS),
    "transformations, planes, calls": siemens.MEANT_NAMES - siemens.CALCULATED_CURVES,
    "drilling cycles: the position is corrected": siemens.CYCLES_AT_POSITION,
    "corners": siemens.CORNERS,
    "calls a program by its name in quotes": siemens.CALLS,
}
KLARTEXT_BLOCKS = (
    *("L", "CC", "C", "CR", "CT", "LP", "CP", "CTP", "LN", "APPR", "DEP", "RND", "CHF", "TOOL CALL", "PLANE"),
    *("FUNCTION TCPM", "LBL", "CALL LBL", "CYCL CALL", "CALL PGM", "SEL PGM", "CALL SELECTED PGM"),
)
KLARTEXT_CYCLES: dict[str, Iterable[int]] = {
    "sets the preset": (heidenhain.PRESET_CYCLE,),
    "drilling: the position is corrected": heidenhain.CYCLES_AT_POSITION,
    "pockets, threads: the position is corrected": heidenhain.CYCLES_AROUND_POSITION,
    "older cycles: from the present position": heidenhain.CYCLES_AT_START,
    "patterns: corrected, if need be hole by hole": heidenhain.PATTERN_CYCLES,
    "calls a program": (heidenhain.PROGRAM_CALL_CYCLE,),
    "data": heidenhain.DATA_CYCLES,
}
KLARTEXT_M = {
    2.0: "end of the program",
    6.0: "tool change",
    30.0: "end of the program",
    89.0: "calls the cycle behind every move, until M99",
    91.0: "machine coordinates: the move stays",
    92.0: "coordinates from a point of the machine manufacturer: the move stays, and its end is not known",
    94.0: "reduces the displayed position of rotary axes",
    99.0: "calls the cycle",
    126.0: "rotary axes on the shortest way",
    127.0: "rotary axes as written",
    128.0: "tool centre point",
    129.0: "end of the tool centre point",
    140.0: "retraction along the tool",
    143.0: "end of the basic rotation",
}
ONLY_DEFINED = heidenhain.HARMLESS_CYCLES.difference(heidenhain.CONTOUR_CYCLES, *KLARTEXT_CYCLES.values())
"""Cycles that may be defined, and that no call may run."""


def iso_entries() -> Iterator[CodeEntry]:
    """FANUC, HAAS, LinuxCNC and others that read ISO code."""
    yield from _numbered("iso", "G", "followed", ISO_FOLLOWED)
    yield from _numbered("iso", "M", "followed", {"subprograms, in the same file or beside it": (98.0, 99.0, 198.0)})
    yield from _numbered("iso", "M", "followed", {"subprograms from a block with a number on (HAAS)": (97.0,)})
    yield from _named("iso", "followed", {"chamfer, rounding: the corner point is corrected": iso.CORNERS})
    yield from _named("iso", "followed", {"the angle of a line: the coordinate replaces it": (iso.ANGLE,)})
    yield from _numbered("iso", "G", "passes", {PASSES: iso.HARMLESS_G})
    yield from _numbered("iso", "M", "passes", {PASSES: shared.HARMLESS_M})
    yield from _refused("iso", "G", iso.REFUSED_G)
    yield from _refused("iso", "M", iso.REFUSED_M)


def siemens_entries() -> Iterator[CodeEntry]:
    """Siemens 840D."""
    yield from _numbered("siemens", "G", "followed", SIEMENS_FOLLOWED)
    yield from _named("siemens", "followed", SIEMENS_WORDS)
    yield from _numbered("siemens", "G", "passes", {PASSES: siemens.HARMLESS_G})
    yield from _numbered("siemens", "M", "passes", {PASSES: shared.HARMLESS_M})
    addresses = (f"{name}=" if len(name) > 1 else name for name in siemens.HARMLESS_ADDRESSES)
    yield from _named("siemens", "passes", {PASSES: siemens.HARMLESS_NAMES | siemens.HARMLESS_CALLS})
    yield from _named("siemens", "passes", {"an address that moves no axis of the path": addresses})
    yield from _named(
        "siemens", "noted", {"cycle whose positions are arguments and are not corrected": siemens.CYCLES_ELSEWHERE}
    )
    yield from _refused("siemens", "G", siemens.REFUSED_G)
    for name, reason in siemens.REFUSED_NAMES.items():
        yield CodeEntry("siemens", name, "refused", reason)
    yield from _named("siemens", "refused", {"turns the coordinates about two axes": siemens.SPATIAL_NAMES})


def heidenhain_entries() -> Iterator[CodeEntry]:
    """Heidenhain Klartext."""
    yield from _named("heidenhain", "followed", {"block that is followed": KLARTEXT_BLOCKS})
    for number, (_, _, what) in heidenhain.FRAME_CYCLES.items():
        yield from _cycles("followed", {what: (number,)})
    yield from _cycles("followed", KLARTEXT_CYCLES)
    for function in sorted(heidenhain.MEANT_M):
        yield CodeEntry("heidenhain", f"M{function:g}", "followed", KLARTEXT_M[function])
    yield from _cycles("noted", {"contours: as programmed, not corrected": heidenhain.CONTOUR_CYCLES})
    yield from _numbered("heidenhain", "M", "passes", {PASSES: heidenhain.HARMLESS_M})
    yield from _named("heidenhain", "passes", {PASSES: (f"FN {n}" for n in sorted(heidenhain.HARMLESS_FN))})
    yield from _refused("heidenhain", "M", heidenhain.REFUSED_M)
    for code, reason in heidenhain.AXIS_M.items():
        yield CodeEntry("heidenhain", f"M{code:g}", "refused", f"with axes: {reason}")
    yield from _cycles("refused", {"may be defined, but not called: its moves are not known": ONLY_DEFINED})
    for number, reason in heidenhain.REFUSED_FN.items():
        yield CodeEntry("heidenhain", f"FN {number}", "refused", reason)
    for kind, reason in heidenhain.REFUSED_KINDS.items():
        yield CodeEntry("heidenhain", kind.replace("_", " "), "refused", reason)


ENTRIES: dict[str, Callable[[], Iterator[CodeEntry]]] = {
    "iso": iso_entries,
    "siemens": siemens_entries,
    "heidenhain": heidenhain_entries,
}
"""The entries of each dialect."""


def _numbered(dialect: str, letter: str, verdict: Verdict, table: Mapping[str, Iterable[float]]) -> Iterator[CodeEntry]:
    for meaning, numbers in table.items():
        for number in sorted(numbers):
            yield CodeEntry(dialect, f"{letter}{number:g}", verdict, meaning)


def _named(dialect: str, verdict: Verdict, table: Mapping[str, Iterable[str]]) -> Iterator[CodeEntry]:
    for meaning, names in table.items():
        for name in sorted(names):
            yield CodeEntry(dialect, name, verdict, meaning)


def _cycles(verdict: Verdict, table: Mapping[str, Iterable[int]]) -> Iterator[CodeEntry]:
    for meaning, numbers in table.items():
        for number in sorted(numbers):
            yield CodeEntry("heidenhain", f"cycle {number}", verdict, meaning)


def _refused(dialect: str, letter: str, table: Mapping[float, str]) -> Iterator[CodeEntry]:
    for number, reason in table.items():
        yield CodeEntry(dialect, f"{letter}{number:g}", "refused", reason)
