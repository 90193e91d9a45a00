"""A comparison of two calibrations for people at a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console

    from calibration.evaluation.comparison import Comparison, Motion


MOTIONS = ("", "unit", "range A", "range B", "RMS B - A", "largest B - A", "at", "U (k=2)", "")
FIGURES = ("", "", "unit", "A", "B", "B - A", "U (k=2)", "")


def show(found: Comparison, names: tuple[str, str], to: Console) -> None:
    """Show tables of error motions and single figures, the volume, and the effects that were left out."""
    to.print(f"machine      {found.machine.name}  {found.machine.chain}")
    for letter, name in zip("AB", names, strict=True):
        to.print(f"{letter}            {name}")
    to.print(f"reference    {', '.join(f'{axis} {at:g}' for axis, at in found.reference.items())}")
    to.print(f"straightness from the {found.straightness} line; slopes are in the squareness")
    to.print("frame        both calibrations are moved into the frame of ncomp fit")
    to.print(_table("error motions, ISO 230-1", MOTIONS, motion_rows(found)))
    if found.figures:
        to.print(_table("single figures", FIGURES, figure_rows(found)))
    for line in volume_lines(found):
        to.print(line)
    for line in found.left_out:
        to.print(f"not compared {line}")


def motion_rows(found: Comparison) -> Iterator[tuple[str, ...]]:
    """One row for each error motion."""
    for motion in found.motions:
        summary = motion.json()
        largest = motion.largest
        yield (
            motion.name,
            motion.unit,
            _known(summary["range"]["a"], motion.known[0]),
            _known(summary["range"]["b"], motion.known[1]),
            f"{summary['rms_difference']:.2f}",
            f"{motion.difference[largest]:+.2f}",
            f"{motion.axis} {motion.positions[largest]:.4g} {motion.position_unit}",
            f"{motion.U[largest]:.2f}",
            verdict(motion),
        )


def verdict(motion: Motion) -> str:
    """A word on the difference: significant, or known in one calibration only; else empty."""
    if not all(motion.known):
        return "in A only" if motion.known[0] else "in B only"
    return "significant" if motion.significant else ""


def figure_rows(found: Comparison) -> Iterator[tuple[str, ...]]:
    """One row for each single figure."""
    for each in found.figures:
        off = each.b - each.a
        told = "significant" if abs(off) > max(each.U, 1e-9) else ""
        yield each.name, each.title, each.unit, f"{each.a:.2f}", f"{each.b:.2f}", f"{off:+.2f}", f"{each.U:.2f}", told


def volume_lines(found: Comparison) -> Iterator[str]:
    """The difference of the tool point over the volume."""
    volume = found.volume
    bounds = ", ".join(f"{axis} {low:g} to {high:g}" for axis, (low, high) in volume.bounds.items())
    yield f"volume       {bounds or 'one position'}; tool {volume.tool_mm:g} mm"
    for title, error in (("as they are", volume.difference), ("aligned", volume.aligned)):
        yield (
            f"difference   {title}: RMS {error.rms:.2f} um, 95 % {error.p95:.2f} um, largest {error.largest:.2f} um "
            f"(standard uncertainty {volume.u_rms_um:.2f} um RMS)"
        )


def _known(value: float, known: bool) -> str:
    return f"{value:.2f}" if known else "-"


def _table(title: str, head: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> Table:
    table = Table(*head, title=title)
    for row in rows:
        table.add_row(*row)
    return table
