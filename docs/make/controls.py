"""Writes docs/controls/: which codes of each control are followed, pass or are refused, from the tables of the code.

    python docs/make/controls.py

Every line comes from a table of `postproc/*/codes.py`, and is tried: ncomp reads a program with the code.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from lines import written  # noqa: E402

import ncomp  # noqa: E402
from kinematics.machine import Machine  # noqa: E402
from postproc.control import codes as shared  # noqa: E402
from postproc.heidenhain import codes as heidenhain  # noqa: E402
from postproc.iso import codes as iso  # noqa: E402
from postproc.siemens import codes as siemens  # noqa: E402

FOLDER = ROOT / "docs" / "controls"
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
    53.1: "G68.2 X0 Y0 Z0 I0 J0 K0\nG53.1",
    68.2: "G68.2 X0 Y0 Z0 I0 J0 K0\nG53.1",
    92.3: "G92 X5.\nG92.2\nG92.3",
}
"""Codes that need others before or behind them."""
HEAD_WITHOUT_LENGTH = HEADS["iso"].replace("G43 H1\n", "")


@cache
def machine(family: str = "") -> Machine:
    """The machine of the trials, with a family of controls."""
    found = ncomp.load_machine("dmu50")
    return dataclasses.replace(found, control=dataclasses.replace(found.control, family=family))


@cache
def refusal(dialect: str, block: str, family: str = "") -> str:
    """The reason why a program with this block is refused; empty where it is accepted."""
    head = HEAD_WITHOUT_LENGTH if block.startswith("G43.1") else HEADS[dialect]
    setup = ncomp.set_up(machine(family), zero=True)
    text = f"{head}{block}\n{ENDS[dialect]}"
    found = ncomp.check(text, machine(family), dialect=dialect, setup=setup, travel_check=False)
    return found.refused[0][2] if found.refused else ""


def taken(code: float, family: str) -> bool:
    """True if an ISO program with the code, and the words that it needs, is accepted."""
    blocks = [TRIALS[code]] if code in TRIALS else [f"G{code:g} {words}".strip() for words in WORDS]
    return any(not refusal("iso", block, family) for block in blocks)


def named(letter: str, numbers: Iterable[float]) -> str:
    """Codes in order, as a reader writes them; runs of whole numbers as ranges."""
    found = sorted(set(numbers))
    runs: list[list[float]] = []
    for number in found:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    texts = (
        [f"`{letter}{run[0]:g}` to `{letter}{run[-1]:g}`"] if len(run) > 3 else [f"`{letter}{n:g}`" for n in run]
        for run in runs
    )
    return ", ".join(text for each in texts for text in each)


def reasons(letter: str, table: Mapping[float, str]) -> Iterator[str]:
    """Rows of refused codes, those of one reason together."""
    for reason in dict.fromkeys(table.values()):
        yield f"| {named(letter, (code for code, own in table.items() if own == reason))} | {reason} |"


def words_of(names: Iterable[str]) -> str:
    """Words in order."""
    return ", ".join(f"`{name}`" for name in sorted(names))


def table(head: str, rows: Iterable[str]) -> list[str]:
    """A table with two columns."""
    return [f"| {head} | |", "|---|---|", *rows, ""]


ISO_FOLLOWED = {
    "moves: rapid, straight, arcs": iso.MOTION,
    "planes": iso.PLANES,
    "inch, mm": iso.UNITS,
    "absolute, incremental": iso.DISTANCES,
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
    "reference positions and machine coordinates: the move stays": (28.0, 30.0, 53.0),
    "subprograms and macros in the same file": (65.0, 66.0, 67.0),
    "fine boring (FANUC); a thread on LinuxCNC": (iso.FINE_BORING,),
}
CALLS = {65.0, 66.0, 67.0}
"""Codes whose trial needs a subprogram in the file: followed by flow.md."""


def iso_page() -> list[str]:
    """FANUC, HAAS, LinuxCNC and others that read ISO code."""
    rows = []
    for meaning, numbers in ISO_FOLLOWED.items():
        for by in dict.fromkeys(_families(code) for code in sorted(numbers)):
            codes = (code for code in numbers if _families(code) == by)
            rows.append(f"| {named('G', codes)} | {meaning} | {by} |")
    return [
        *_title("FANUC, HAAS, LinuxCNC and other ISO controls", "ISO"),
        "## Followed and corrected",
        "",
        "The third column names the `family` in the [machine file](../machines.md) that a code needs, if it needs one:",
        "without it the meaning would depend on the control.",
        "",
        "| code | meaning | with |",
        "|---|---|---|",
        *rows,
        "",
        *_passing("G", iso.HARMLESS_G, shared.HARMLESS_M),
        "An M function that is not in these lists is taken to move nothing and to set no variable, and a note names it.",
        "",
        "## Refused",
        "",
        *table("code", (*reasons("G", iso.REFUSED_G), *reasons("M", iso.REFUSED_M))),
        "Any other G code is refused as not known.",
        "",
        *_more("Variables, jumps, loops and subprograms: [ISO](../flow.md#iso)."),
    ]


def _families(code: float) -> str:
    if code in CALLS:
        return "every family"
    found = [family for family in ("", "fanuc", "linuxcnc") if taken(code, family)]
    return "every family" if "" in found else " or ".join(f'`"{family}"`' for family in found) or "refused"


def siemens_page() -> list[str]:
    """Siemens 840D."""
    followed = {
        "moves: rapid, straight, arcs": named("G", siemens.MOTION),
        "planes, units, distances": named("G", (*siemens.PLANES, *siemens.UNITS, *siemens.DISTANCES)),
        "feed": named("G", siemens.FEED_MODES),
        "work offsets": named("G", siemens.WORK_OFFSETS),
        "machine coordinates, reference positions: the move stays": named("G", siemens.MACHINE | siemens.REFERENCE),
        "limits": named("G", siemens.LIMITS),
        "poles and polar coordinates": f"{named('G', siemens.POLES)}, `AP=`, `RP=`",
        "radius compensation": named("G", (*siemens.COMPENSATION, siemens.COMPENSATION_END)),
        "programmable frames": words_of(siemens.FRAME_NAMES - siemens.SPATIAL_NAMES),
        "arcs that the control calculates": words_of(siemens.CALCULATED_ARCS),
        "transformations, planes, calls": words_of(siemens.MEANT_NAMES - siemens.CALCULATED_ARCS),
        "drilling cycles: the position is corrected": words_of(siemens.CYCLES_AT_POSITION),
        "corners": words_of(siemens.CORNERS),
    }
    return [
        *_title("Siemens 840D", "Siemens"),
        "## Followed and corrected",
        "",
        *table("code", (f"| {codes} | {meaning} |" for meaning, codes in followed.items())),
        *_passing("G", siemens.HARMLESS_G, shared.HARMLESS_M),
        f"Words: {words_of(siemens.HARMLESS_NAMES | siemens.HARMLESS_CALLS)}.",
        "",
        f"Addresses: {words_of(siemens.HARMLESS_ADDRESSES)}.",
        "",
        "## Passed with a note: positions are arguments and are not corrected",
        "",
        words_of(siemens.CYCLES_ELSEWHERE) + ".",
        "",
        "## Refused",
        "",
        *table("code", reasons("G", siemens.REFUSED_G)),
        *table("word", _name_reasons(siemens.REFUSED_NAMES)),
        f"Spatial rotations are refused: {words_of(siemens.SPATIAL_NAMES)}. Any other G code, cycle or word is refused",
        "as not known.",
        "",
        *_more("Variables, jumps, loops, subprograms, CYCLE800 and TRAORI: [Siemens 840D](../flow.md#siemens-840d)."),
    ]


def _name_reasons(names: Mapping[str, str]) -> Iterator[str]:
    for reason in dict.fromkeys(names.values()):
        yield f"| {words_of(name for name, own in names.items() if own == reason)} | {reason} |"


def heidenhain_page() -> list[str]:
    """Heidenhain Klartext."""
    frames = heidenhain.FRAME_CYCLES.items()
    return [
        *_title("HEIDENHAIN Klartext", "Klartext"),
        "## Followed and corrected",
        "",
        "`L`, `CC`, `C`, `CR`, `CT`, `LP`, `CP`, `CTP`, `LN`, `APPR`, `DEP`, `RND`, `CHF`, `TOOL CALL`, `PLANE`,",
        "`FUNCTION TCPM`, labels, `CYCL CALL`, and:",
        "",
        *table(
            "cycle",
            (
                *(f"| {number} | {what} |" for number, (_, _, what) in frames),
                f"| {heidenhain.PRESET_CYCLE} | sets the preset |",
                f"| {_cycles(heidenhain.CYCLES_AT_POSITION)} | drilling: the position is corrected |",
                f"| {_cycles(heidenhain.CYCLES_AROUND_POSITION)} | pockets, threads: the position is corrected |",
                f"| {_cycles(heidenhain.CYCLES_AT_START)} | older cycles: from the present position |",
                f"| {_cycles(heidenhain.CONTOUR_CYCLES)} | contours: as programmed, not corrected |",
                f"| {_cycles(heidenhain.PATTERN_CYCLES)} | patterns: their one position is corrected |",
                f"| {_cycles(heidenhain.DATA_CYCLES)} | data |",
            ),
        ),
        *table("M function", (f"| {named('M', heidenhain.MEANT_M)} | followed |",)),
        "## Pass unchanged",
        "",
        f"M functions: {named('M', heidenhain.HARMLESS_M)}.",
        "",
        f"Functions: {', '.join(f'`FN {n}`' for n in sorted(heidenhain.HARMLESS_FN))}.",
        "",
        "An M function that is not in these lists is taken to move nothing and to set no variable, and a note names it.",
        "",
        "## Refused",
        "",
        *table("M function", reasons("M", heidenhain.REFUSED_M)),
        *table("M function with axes", reasons("M", heidenhain.AXIS_M)),
        *table(
            "block",
            (
                *(f"| cycle {number} | {reason} |" for number, reason in heidenhain.REFUSED_CYCLES.items()),
                *(f"| `FN {number}` | {reason} |" for number, reason in heidenhain.REFUSED_FN.items()),
                *(f"| {kind.replace('_', ' ')} | {reason} |" for kind, reason in heidenhain.REFUSED_KINDS.items()),
            ),
        ),
        "Any other cycle, function or block is refused as not known.",
        "",
        *_more("Parameters, labels, poles, planes, datums: [HEIDENHAIN Klartext](../flow.md#heidenhain-klartext)."),
    ]


def _cycles(numbers: Iterable[int]) -> str:
    return named("", map(float, numbers)).replace("`", "")


def _title(control: str, dialect: str) -> list[str]:
    return [
        f"# {control}: is my code supported?",
        "",
        f"Written by `python docs/make/controls.py` from the tables by which ncomp reads {dialect} programs; do not",
        "edit.",
        "",
        "To see it for a program of your own, line by line and without a calibration:",
        "",
        "    ncomp check part.nc --machine dmu50",
        "",
    ]


def _passing(letter: str, codes: Iterable[float], m: Iterable[float]) -> list[str]:
    return ["## Pass unchanged", "", f"{named(letter, codes)}; {named('M', m)}.", ""]


def _more(text: str) -> list[str]:
    return ["## More", "", text, ""]


PAGES = {"iso": iso_page, "siemens": siemens_page, "heidenhain": heidenhain_page}


def main() -> None:
    """Write the pages."""
    FOLDER.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        (FOLDER / f"{name}.md").write_text(written(page()))


if __name__ == "__main__":
    main()
