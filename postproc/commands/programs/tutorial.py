"""`ncomp tutorial`: the files of the tutorial."""

from __future__ import annotations

from pathlib import Path

from kinematics.files import write_folder
from postproc.commands.options.declared import argument

EPILOG = "Example:\n\n`ncomp tutorial mill`"

FOLDER = Path(__file__).parents[2] / "tutorial"


def tutorial(*, folder: Path = argument("New folder.", "FOLDER", writes="folder")) -> None:
    """Write the files of the tutorial (docs/tutorial.md) into a new folder: a machine, its measurement, a program."""
    from postproc.commands.show.terminal import output

    files = {path.name: path.read_bytes() for path in sorted(FOLDER.iterdir()) if path.is_file()}
    write_folder(folder, files)
    output.print(f"written: {', '.join(files)} in {folder}")
