"""`ncomp machines`: the shipped machines, or one machine file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.files import machine_file
from postproc.commands.options.shared import machine_names, made_now
from rendering.report import Report, Section, Table, facts

if TYPE_CHECKING:
    from kinematics.machine import Machine

EPILOG = (
    "Examples:\n\n`ncomp machines`\n\n`ncomp machines dmu50`\n\n`ncomp machines my_mill.toml`\n\n"
    "`ncomp machines dmu50 --draw dmu50.svg`  draws the chain, with axes, pivots and positive directions"
)


def machines(
    *,
    name: str | None = argument(
        "Name of a machine, or path of its .toml file.",
        "NAME",
        default=None,
        complete=machine_names,
        reads=machine_file,
    ),
    draw: Path | None = option(
        "Drawing of the chain with axes, pivots and positive directions.", "FILE.svg", writes="file"
    ),
) -> None:
    """List the machines, or show one machine and check its file.

    Shipped machines come first. Your own are the .toml files of the folders in NCOMP_MACHINES, and of the folder
    machines in the configuration of ncomp (ncomp doctor names it).
    """
    import numpy as np

    import machines as shipped
    from postproc.commands.show.terminal import say, show

    if name is None:
        if draw is not None:
            raise UserError(f"--draw {draw}: name the machine to draw, ncomp machines NAME --draw {draw}")
        _list()
        return
    machine = ncomp.load_machine(name)
    path = shipped.default_calibration(machine)
    file = shipped.path_of(name)
    report = _report(machine, "none of its own" if path is None else path.name, "" if str(file) == name else str(file))
    if draw is not None:
        _draw(machine, draw)
    show(report)
    if draw is not None:
        say("written", str(draw))
    if int(np.linalg.matrix_rank([axis.unit_direction for axis in machine.axes if not axis.rotary])) < 3:
        say("note", "the linear axes do not span space: programs for this machine are refused")


def _list() -> None:
    """All machines: the shipped ones, and those of the user with their files."""
    import machines as shipped
    from postproc.commands.show.terminal import output

    for each in shipped.names():
        machine = shipped.load(each)
        output.print(f"{each:<12} {machine.chain:<24} {machine.description}")
    for path in shipped.own():
        try:
            machine = shipped.load(str(path))
        except UserError as fault:
            output.print(f"{path.stem:<12} cannot be used: {fault}")
            continue
        hidden = "; the shipped machine of this name is used in its place" if path.stem in shipped.names() else ""
        output.print(f"{path.stem:<12} {machine.chain:<24} {machine.description} ({path}{hidden})")


def _draw(machine: Machine, target: Path) -> None:
    """Write the drawing of a machine in the form of its suffix."""
    from kinematics.files import write_whole

    form = target.suffix.lower()
    if form == ".svg":
        from postproc.commands.show.chain_svg import chain_svg

        write_whole(target, chain_svg(machine))
    elif form in (".html", ".htm"):
        from postproc.commands.show.chain_page import chain_report
        from rendering.page import page

        report = chain_report(machine)
        write_whole(target, page(replace(report, head=made_now(report.head))))
    else:
        raise UserError(f"--draw {target}: expected a name that ends in .svg or .html")


def _report(machine: Machine, calibration: str, file: str) -> Report:
    """Chain, axes, work offsets and tools of a machine; `file`: that of a machine found by its name."""
    from postproc.commands.show.chain import travel_of

    chain = f"{machine.chain}   (ISO 10791-6, workpiece to tool)"
    rows = [("machine", machine.name), ("chain", chain), ("calibration", calibration)]
    if file:
        rows.insert(1, ("file", file))
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
            travel_of(axis),
            f"{axis.home:g}",
            f"{axis.resolution:g}",
        )
        for axis in machine.axes
    ]
    head = ("axis", "carries", "tool moves (ISO 841)", "point, mm", "travel", "home", "resolution")
    return Report(
        machine.name, "", [facts("Machine", rows), Section("Axes", table=Table(head, axes))], machine.description
    )
