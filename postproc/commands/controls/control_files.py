"""Folders of files for a control."""

from __future__ import annotations

from pathlib import Path


def write_probe(output: Path, files: dict[str, str]) -> None:
    """Write the folder of a probe, and name the file to read first."""
    from kinematics.files import write_folder
    from postproc.commands.show.terminal import say

    write_folder(output, encoded(files))
    say("probe", f"read {output / 'probe.md'} before loading anything")


def encoded(files: dict[str, str]) -> dict[str, bytes]:
    """Files as bytes: a control's files in ASCII."""
    return {name: text.encode("utf-8" if name.endswith(".md") else "ascii") for name, text in files.items()}
