"""`ncomp machines`: the shipped machines, or one machine file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import ncomp
from postproc.commands.options.declared import argument
from rendering.report import Report, Section, Table, facts

if TYPE_CHECKING:
    from kinematics.machine import Machine

EPILOG = "Examples:\n\n`ncomp machines`\n\n`ncomp machines dmu50`\n\n`ncomp machines my_mill.toml`"


def machines(
    name: str | None = argument("Name of a machine, or path of its .toml file.", "NAME", default=None),
) -> None:
    """List the shipped machines, or show one machine and check its file."""
    import numpy as np

    import machines as shipped
    from postproc.commands.show.terminal import output, say, show

    if name is None:
        for each in shipped.names():
            machine = shipped.load(each)
            output.print(f"{each:<12} {machine.chain:<24} {machine.description}")
        return
    machine = ncomp.load_machine(name)
    path = shipped.default_calibration(machine)
    show(_report(machine, "none of its own" if path is None else path.name))
    if int(np.linalg.matrix_rank([axis.unit_direction for axis in machine.axes if not axis.rotary])) < 3:
        say("note", "the linear axes do not span space: programs for this machine are refused")


def _report(machine: Machine, calibration: str) -> Report:
    """Chain, axes, work offsets and tools of a machine."""
    chain = f"{machine.chain}   (ISO 10791-6, workpiece to tool)"
    rows = [("machine", machine.name), ("chain", chain), ("calibration", calibration)]
    for name, offset in machine.work_offsets.items():
        values = ", ".join(f"{axis} {value:g}" for axis, value in offset.items()) or "0"
        rows.append(("work offset", f"{name}: {values}{' (assumed)' if machine.offsets_assumed else ''}"))
    for name, length in machine.tools.items():
        rows.append(("tool length", f"{name}: {length:g} mm{' (assumed)' if machine.tools_assumed else ''}"))
    axes = [
        (
            axis.name,
            axis.side,
            f"{'turns about' if axis.rotary else 'along'} ({', '.join(f'{v:g}' for v in axis.direction)})",
            f"({', '.join(f'{v:g}' for v in axis.point)})",
            f"{axis.travel[0]:g}..{axis.travel[1]:g} {axis.unit}",
            f"{axis.home:g}",
            f"{axis.resolution:g}",
        )
        for axis in machine.axes
    ]
    head = ("axis", "carries", "tool moves (ISO 841)", "point, mm", "travel", "home", "resolution")
    return Report(
        machine.name, "", [facts("Machine", rows), Section("Axes", table=Table(head, axes))], machine.description
    )
