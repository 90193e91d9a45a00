"""The files of a command line: no output replaces an input or another output, and each can be written."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

from kinematics.files.inputs import FileSet, overwritten
from kinematics.files.mistaken import missing
from kinematics.user_error import UserError

Form = Literal["file", "folder", "any"]
"""What an output is; `any` where the other options decide between a file and a folder."""


def check_files(inputs: Iterable[str | Path | None], outputs: Mapping[str, str | Path | None]) -> list[str | Path]:
    """The inputs that are given; UserError, before any work is done, for outputs that cannot be written.

    outputs: files by their options. Two outputs with one file, and an output that would overwrite one of the inputs,
    are refused as well; `-` is standard input or output.
    """
    given = [path for path in inputs if path is not None]
    refuse_same_output(outputs)
    refuse_inputs(given, outputs.values())
    for name, output in outputs.items():
        if output is not None and str(output) != "-":
            refuse_unwritable(name, output)
    return given


def refuse_same_output(outputs: Mapping[str, str | Path | None]) -> None:
    """UserError for two outputs, by their options, with one file or with standard output."""
    seen = FileSet()
    streams = [name for name, output in outputs.items() if str(output) == "-"]
    if len(streams) > 1:
        raise UserError(f"{streams[0]} and {streams[1]} cannot both go to standard output; name a file for one")
    for name, output in outputs.items():
        if output is None or str(output) == "-":
            continue
        if (other := seen.find(output)) is not None:
            raise UserError(f"{other} and {name} both name {output}; name two files")
        seen.add(output, name)


def refuse_inputs(inputs: Iterable[str | Path], outputs: Iterable[str | Path | None]) -> None:
    """UserError for an output that would overwrite one of the inputs."""
    read = FileSet()
    for each in inputs:
        if str(each) != "-":
            read.add(each)
    for output in outputs:
        if output is not None and str(output) != "-" and output in read:
            raise overwritten(output)


def refuse_unwritable(name: str, output: str | Path) -> None:
    """UserError for a file that cannot be written; name: its option."""
    path = Path(output)
    if name == "--report" and path.suffix.lower() == ".pdf":
        html = path.with_suffix(".html")
        raise UserError(f"--report {output}: a page is HTML; name {html}, and ncomp report {html} --pdf {output}")
    if path.is_dir() or str(output).endswith(("/", os.sep)):
        raise UserError(f"cannot write {output}: Is a directory: give the name of a file")
    if not path.parent.is_dir():
        if path.parent.exists():
            raise UserError(f"cannot write {output}: Not a directory: {path.parent} is a file; name a folder")
        raise UserError(f"cannot write {output}: No such file or directory{missing(path)}: make the folder")


def machine_file(name: str | None) -> Path | None:
    """The file of a machine that is given by its name or path; None for a name of none."""
    import machines

    try:
        return None if name is None else machines.path_of(name)
    except UserError:
        return None


def file_of_calibration(text: str | None) -> Path | None:
    """The file of a calibration, which may be `none`."""
    return None if text in (None, "none") else Path(str(text))


def file_of_database(text: str | None) -> Path | None:
    """The file of a database, which may be a URL."""
    return None if text is None or "://" in text else Path(text)


def file_if_there(text: str | None) -> Path | None:
    """The file of an option whose value is a name or a path: the path if there is a file."""
    return Path(text) if text is not None and Path(text).is_file() else None
