"""Valid inputs beside those of `mutated_files`: examples of the documentation, height maps, logs, and real data."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import machines

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data"
PAGES = ("docs/drift.md", "docs/measurements/*.md")
REAL = {
    "iso230/x_iso230_2_report.md": 400,
    "resolver/ResolverCiclicError2.csv": 60,
    "plug_plates/*": 60,
}
"""Real measurements, with the number of lines that are kept."""
Found = tuple[str, str, str, tuple[str, ...]]
"""Kind, name, text and further arguments of the reader."""


def files() -> Iterator[Found]:
    """All of them that are there."""
    yield from _examples()
    yield from _height_maps()
    yield from _real()
    spheres = ROOT / "examples" / "spheres"
    log = "".join((spheres / "ncomp40661.txt").read_text().splitlines(keepends=True)[:200])
    plan, machine = spheres / "spheres.csv", spheres / "machine.json"
    yield "touches", "ncomp40661.txt", log, ("--machine", "dmu50", "--plan", str(plan))
    yield "calibration", "cal.json", machine.read_text(), ()


def _examples() -> Iterator[Found]:
    """The measurement files in the pages, which are blocks of indented lines."""
    for page in sorted(path for pattern in PAGES for path in ROOT.glob(pattern)):
        for block in re.findall(r"(?:^    .*\n)+", page.read_text(), re.MULTILINE):
            text = textwrap.dedent(block)
            named = re.search(r"^# machine: *(\w+)$", text, re.MULTILINE)
            if named and "# instrument:" in text:
                machine = named[1] if named[1] in machines.names() else "gantry"
                text = text.replace(named[0], f"# machine: {machine}")
                for kind in ("data", "fit"):
                    yield kind, f"{page.stem}.csv", text, ("--machine", machine)


def _height_maps() -> Iterator[Found]:
    from support.height_map_files import FORMS

    for name, text in FORMS.items():
        yield "height-map", name, text, ()


def _real() -> Iterator[Found]:
    for pattern, lines in REAL.items():
        for path in sorted(SHARED.glob(pattern)):
            text = "".join(path.read_bytes().decode("latin-1").splitlines(keepends=True)[:lines])
            for kind in ("data", "iso230"):
                yield kind, path.name, text, ("--machine", "gantry")
