"""Share of the moves of NC programs that are read in bulk: `python benchmarks/plain_share.py FOLDER [MACHINE]`.

For each program the number of its lines with coordinates, and how many of them are in runs of plain lines; a line that
its dialect does not know counts too.
"""

from __future__ import annotations

import sys
from pathlib import Path

import machines
from kinematics.user_error import UserError
from postproc.dialects import find_dialect
from postproc.program_lines import read_blocks
from postproc.text.block import Refusal
from postproc.text.blocks import PlainRun
from postproc.text.source import open_source

AXES = "XYZABCUVW"
CENTRES = frozenset("IJKR")


def moves(path: Path, axes: str) -> tuple[int, int, int]:
    """Lines in runs, other lines with coordinates, and lines of arcs among the latter, up to the first unknown line."""
    source = open_source(str(path))
    dialect = find_dialect("auto", source.name, source.text_head)
    runs = others = arcs = 0
    try:
        for item in read_blocks(source, dialect, axes):
            if isinstance(item, PlainRun):
                runs += len(item)
                continue
            addresses = {word.address.removeprefix("I") or "I" for word in item.words}
            if item.kind in ("words", "line") and addresses & set(AXES):
                others += 1
                arcs += not CENTRES.isdisjoint(addresses)
    except Refusal:
        pass
    return runs, others, arcs


def main(folder: Path, name: str) -> None:
    """Count and print."""
    axes = "".join(machines.load(name).names) if name else AXES
    total = [0, 0, 0]
    for path in sorted(folder.rglob("*.*")):
        try:
            found = moves(path, axes)
        except UserError:
            continue
        total = [a + b for a, b in zip(total, found, strict=True)]
        if sum(found) >= 100:
            print(f"{path.name:32} {_text(found)}")
    print(f"{'all':32} {_text(total)}")


def _text(found: list[int] | tuple[int, int, int]) -> str:
    runs, others, arcs = found
    share = f"{runs / (runs + others):6.1%}" if runs + others else "     -"
    return f"{runs:7} of {runs + others:7} moves in bulk ({share}); {arcs:5} of the others are arcs"


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "")
