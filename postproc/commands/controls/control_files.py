"""Folders of files for a control."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from postproc.commands.options.shared import ResultOptions
    from rendering.report import Report


def write_probe(output: Path, files: dict[str, str]) -> None:
    """Write the folder of a probe, and name the file to read first."""
    from kinematics.files import write_folder
    from postproc.commands.show.terminal import say

    write_folder(output, encoded(files))
    say("probe", f"read {output / 'probe.md'} before loading anything")


def probe_command(machine: str, found: Machine, format: str, *, rotary: bool) -> str:
    """The command that writes a probe for the sign of a format, of the first axis of this kind; `machine`: as given."""
    axis = next((each.name for each in found.axes if each.rotary == rotary), found.axes[0].name)
    return shlex.join(("ncomp", "export", "--machine", machine, "--format", format, "--probe", axis, "-o", "probe"))


def show_export(report: Report, last: str, others: ResultOptions) -> None:
    """Show the tables of an export; its texts are on the page and in sheet.md."""
    from postproc.commands.show.terminal import say, show

    tables = [each for each in report.sections if each.table is not None]
    show(msgspec.structs.replace(report, sections=tables), *others.files)
    say("written", last)


def encoded(files: dict[str, str]) -> dict[str, bytes]:
    """Files as bytes: a control's files in ASCII."""
    return {name: text.encode("utf-8" if name.endswith(".md") else "ascii") for name, text in files.items()}
