"""Exports for routers and printers in the controls that they are for: the table of docs/tables.md.

    python -m benchmarks.consumers

Errors of the tool point in X, Y and Z of the machine, um RMS at 400 positions (12 in LinuxCNC's simulator). Klipper's
code and LinuxCNC's matrixkins run where they are installed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from clients import klipper
from support.consumers import CONSUMERS, IN_LINUXCNC, Consumer, linuxcnc_has_matrixkins, outcome


def row(form: str, consumer: Consumer, count: int, before: tuple[str, Consumer] | None = None) -> str:
    """A line of the table; `before`: a format that was exported first."""
    found = outcome(form, consumer, count, before)
    without, left = (np.sqrt(np.mean(errors**2, axis=0)) for errors in (found.before, found.after))
    cells = " | ".join(f"{old:.1f} -> {new:.1f}" for old, new in zip(without, left, strict=True))
    name = f"`{form}`" if before is None else f"`{before[0]}`, then `{form}`"
    return f"| {name} | {consumer.runs} | {cells} | {np.linalg.norm(without):.1f} -> {np.linalg.norm(left):.1f} |"


def main() -> None:
    """Print the table."""
    print("| format | run as | X, um | Y, um | Z, um | together, um |")
    print("|---|---|---|---|---|---|")
    for form, consumer in CONSUMERS.items():
        if not consumer.client or klipper.available():
            print(row(form, consumer, 400))
    print(row("marlin", CONSUMERS["marlin"], 400, ("grbl", CONSUMERS["grbl"])))
    if linuxcnc_has_matrixkins():
        print(row("linuxcnc-matrix", IN_LINUXCNC, 12))


if __name__ == "__main__":
    main()
