"""`ncomp hook`: the files by which a CAM calls ncomp after every post."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from kinematics.files import write_whole, writing
from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option

EPILOG = "Examples:\n\n`ncomp hook`\n\n`ncomp hook freecad --install`\n\n`ncomp hook nx -o C:/ncomp`"

FOLDER = Path(__file__).parents[2] / "hooks"
HOOKS: dict[str, tuple[str, str]] = {
    "freecad": ("ncomp_post.py", "FreeCAD: a post-processor that wraps any stock post"),
    "fusion": ("ncomp_fusion.js", "Fusion, Inventor CAM, HSMWorks: text to append to a post"),
    "nx": ("ncomp_nx.tcl", "NX: Tcl to source at the end of a post"),
    "windows": ("after_post.cmd", "Mastercam, SolidCAM, hyperMILL and others: a command for each posted program"),
    "unix": ("after_post.sh", "the same on Linux and macOS"),
}
"""File of each hook, and its CAM."""


def hook(
    *,
    cam: str | None = argument(
        "Name of a hook; without it, the list.", "NAME", default=None, complete=lambda: list(HOOKS)
    ),
    output: Path | None = option("Folder for the file; without it, standard output.", "FOLDER", "-o", writes="folder"),
    install: bool = option("Copy the post into FreeCAD's macro folders.", default=False),
) -> None:
    """Write the file by which a CAM calls ncomp after every post, or list these files."""
    from postproc.commands.show.terminal import output as screen

    if cam is not None and cam not in HOOKS:
        raise UserError(f"unknown hook {cam!r}{did_you_mean(cam, HOOKS)}: there are {', '.join(HOOKS)}")
    if install and (cam != "freecad" or output is not None):
        raise UserError("--install is for freecad alone, without -o: write the other hooks with -o FOLDER")
    if cam is None:
        for name, (_, meaning) in HOOKS.items():
            screen.print(f"{name:<9} {meaning}")
        return
    file = FOLDER / HOOKS[cam][0]
    if not install and output is None:
        screen.print(file.read_text().rstrip("\n"))
        return
    for folder in _macro_folders() if output is None else [output]:
        if folder.exists() and not folder.is_dir():
            raise UserError(f"cannot write {folder}: it is a file: name a folder")
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        target = folder / file.name
        line_end = "\r\n" if file.suffix == ".cmd" else "\n"
        write_whole(target, _with_path(file.read_text()).replace("\n", line_end).encode())
        if cam == "unix":
            target.chmod(target.stat().st_mode | 0o111)
        screen.print(f"written: {target}")


def _with_path(text: str) -> str:
    """The text of a hook with the path of this ncomp: a CAM may not find the command by its name."""
    beside = Path(sys.executable).with_name("ncomp.exe" if sys.platform == "win32" else "ncomp")
    found = str(beside) if beside.is_file() else shutil.which("ncomp") or "ncomp"
    found = found if "@echo off" in text else Path(found).as_posix()
    for quoted in ('"{}"', "{{{}}}"):
        text = text.replace(quoted.format("ncomp"), quoted.format(found), 1)
    return text


def _macro_folders() -> list[Path]:
    """The macro folders of all versions of FreeCAD of this user; they are made where FreeCAD has its own folder."""
    import platformdirs

    own = Path(platformdirs.user_data_dir("FreeCAD", appauthor=False, roaming=True))
    if not own.is_dir():
        raise UserError(
            f"FreeCAD has no folder {own}: start it once, or give its macro folder (in FreeCAD: Edit, Preferences, "
            "General, Macro) as in 'ncomp hook freecad -o FOLDER'"
        )
    versions = sorted(path for path in own.glob("v*") if path.is_dir())
    folders = [path / "Macro" for path in (own, *versions)]
    for folder in folders:
        folder.mkdir(exist_ok=True)
    return folders
