"""Writes docs/controls/: which codes of each control are followed, pass or are refused, from the tables of the code.

    python docs/make/controls.py

Every line is an entry of `postproc/code_tables`, as `ncomp codes` shows it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from lines import written  # noqa: E402

from postproc.code_tables.entries import ANY_OTHER, CONTROLS, ENTRIES, VERDICTS, CodeEntry, Verdict  # noqa: E402
from postproc.code_tables.trials import ANY, FAMILIES, families_of  # noqa: E402

FOLDER = ROOT / "docs" / "controls"
TITLES = {
    "iso": "FANUC, HAAS, LinuxCNC and other ISO controls",
    "siemens": "Siemens 840D",
    "heidenhain": "HEIDENHAIN Klartext",
}
HEADINGS: dict[Verdict, str] = {
    "followed": "Followed and corrected",
    "passes": "Pass unchanged",
    "noted": "Passed with a note: positions are not corrected",
    "refused": "Refused",
}
LONGEST_RUN = 12
"""Codes of one meaning with consecutive numbers, above which the list of all codes has a range."""
MORE = {
    "iso": "Variables, jumps, loops and subprograms: [ISO](../flow.md#iso).",
    "siemens": "Variables, jumps, loops, subprograms, CYCLE800 and TRAORI: [Siemens 840D](../flow.md#siemens-840d).",
    "heidenhain": "Parameters, labels, poles, planes, datums: [HEIDENHAIN Klartext](../flow.md#heidenhain-klartext).",
}


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


def grouped(entries: Iterable[CodeEntry]) -> Iterator[tuple[str, str, str]]:
    """Codes of one meaning together: their names, the meaning, and the families that a code needs."""
    groups: dict[tuple[str, str, str], list[CodeEntry]] = {}
    for entry in entries:
        groups.setdefault((entry.letter, entry.meaning, with_family(entry)), []).append(entry)
    for (letter, meaning, family), members in groups.items():
        yield codes_of(letter, members), meaning, family


def codes_of(letter: str, members: list[CodeEntry]) -> str:
    """Codes in order."""
    if letter:
        return named(letter, (each.number for each in members))
    return ", ".join(f"`{each.code}`" for each in members)


def with_family(entry: CodeEntry) -> str:
    """The families of which an ISO code needs one."""
    families = families_of(entry)
    if families == FAMILIES:
        return "every family"
    named = families if ANY not in families else [each for each in FAMILIES if each not in families]
    *others, last = [f'`"{each}"`' for each in named] or ["refused"]
    word = "and" if ANY in families else "or"
    joined = f"{', '.join(others)} {word} {last}" if others else last
    return f"every family but {joined}" if ANY in families else joined


def rows_of(dialect: str, verdict: Verdict, entries: list[CodeEntry]) -> list[str]:
    """The table of the codes of one verdict."""
    own = [entry for entry in entries if entry.verdict == verdict]
    if dialect == "iso" and verdict in ("followed", "passes"):
        head = ["| code | meaning | with |", "|---|---|---|"]
        return [*head, *(f"| {codes} | {meaning} | {family} |" for codes, meaning, family in grouped(own)), ""]
    return ["| code | |", "|---|---|", *(f"| {codes} | {meaning} |" for codes, meaning, _ in grouped(own)), ""]


def one_by_one(entries: list[CodeEntry]) -> Iterator[str]:
    """A row for each code, in the order of their names; long runs of one meaning are a range."""
    runs: dict[tuple[str, str, str], list[CodeEntry]] = {}
    for entry in entries:
        runs.setdefault((entry.letter, entry.verdict, entry.meaning), []).append(entry)
    rows = []
    for (letter, _, meaning), members in runs.items():
        text = codes_of(letter, members)
        together = bool(letter) and text.count("`") == 4 and len(members) > LONGEST_RUN
        for each in members[:1] if together else members:
            shown = text if together else f"`{each.code}`"
            order = (each.letter or "~", each.number if each.letter else 0.0, each.code)
            family = with_family(each)
            needs = "" if family == "every family" else f" with {family}"
            rows.append((order, f"| {shown} | {VERDICTS[each.verdict]}{needs} | {meaning} |"))
    return (row for _, row in sorted(rows))


def page(dialect: str) -> list[str]:
    """The page of a dialect."""
    entries = list(ENTRIES[dialect]())
    lines = [
        f"# {TITLES[dialect]}: is my code supported?",
        "",
        "Written by `python docs/make/controls.py` from the tables by which ncomp reads these programs; do not edit.",
        f"The controls that are meant: {CONTROLS[dialect]}.",
        "",
        "One code, or words of its meaning, in the terminal:",
        "",
        f"    ncomp codes {'cycle 200' if dialect == 'heidenhain' else 'G54'}",
        f"    ncomp codes --dialect {dialect} datum",
        "",
        "To see it for a program of your own, line by line and without a calibration:",
        "",
        "    ncomp check part.nc --machine dmu50",
        "",
    ]
    for verdict, heading in HEADINGS.items():
        if any(entry.verdict == verdict for entry in entries):
            lines += [f"## {heading}", ""]
            if dialect == "iso" and verdict == "followed":
                lines += [
                    "The third column names the `family` in the [machine file](../machines.md) that a code needs, if it "
                    "needs one: without it the meaning would depend on the control.",
                    "",
                ]
            lines += rows_of(dialect, verdict, entries)
    lines += [ANY_OTHER[dialect], "", "## All codes, one by one", "", "| code | ncomp | |", "|---|---|---|"]
    return [*lines, *one_by_one(entries), "", "## More", "", MORE[dialect], ""]


def main() -> None:
    """Write the pages."""
    FOLDER.mkdir(exist_ok=True)
    for name in ENTRIES:
        (FOLDER / f"{name}.md").write_text(written(page(name)))


if __name__ == "__main__":
    main()
