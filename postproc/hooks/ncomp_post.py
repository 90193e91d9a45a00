"""FreeCAD post-processor *ncomp*: a stock post of FreeCAD, and its program corrected by the ncomp command.

`ncomp hook freecad --install` copies this file into FreeCAD's macro folder. Arguments of the Job, for example

    --stock linuxcnc --machine dmu50 --work-offset G54=-30,-20,150 --tool-length T1=80 -- --no-header --precision=4

After `--` are those of the stock post. Before it, `--stock NAME` is the stock post, `--ncomp COMMAND` the path of the
ncomp command, and all others are options of `ncomp correct`, whose paths are relative to the folder of the output file.
The output file is written by ncomp only, complete or not at all; an older one of its name is removed first. Runs in
FreeCAD's own Python (3.8 or later) and needs only FreeCAD.
"""

from __future__ import annotations

import argparse
import importlib
import os
import shlex
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

import FreeCAD

COMMAND = "ncomp"
"""The ncomp command; `ncomp hook` writes its path here."""
TOOLTIP = __doc__
TOOLTIP_ARGS = "--stock NAME --machine NAME [options of ncomp correct] [-- arguments of the stock post]"
TIMEOUT_S = 3600
"""Time after which a correction is ended, s."""
OF_FREECAD = ("PYTHONHOME", "PYTHONPATH", "LD_LIBRARY_PATH")
"""Environment variables that FreeCAD sets for its own Python, and that ncomp's Python must not see."""
NAMED_BY_HEIDENHAIN = (
    *("PathToolController", "PathProfileEdges", "PathMillFace", "PathHelix"),
    *("PathProfileFaces", "PathProfileContour", "PathDrilling"),
)
"""Modules that heidenhain_post of FreeCAD 0.20 uses without an import."""


def export(objectslist: list[Any], filename: str, argstring: str) -> str:
    """Post with the stock post, correct with ncomp; the text of the corrected program, which is in `filename` too."""
    ours, ncomp_options, stock_arguments = _arguments(argstring)
    to_file = filename not in ("", "-")  # FreeCAD 1.x gives `-` and writes the text itself
    with tempfile.TemporaryDirectory(prefix="ncomp-") as folder:
        name = Path(filename).name if to_file else "program.nc"
        posted = Path(folder, name)
        output = Path(filename).absolute() if to_file else Path(folder, f"corrected-{name}")
        try:
            output.unlink(missing_ok=True)  # no older program is taken for the output of this run
        except OSError as fault:
            _fail(f"cannot replace {output}: {fault.strerror}")
        _post(ours.stock, objectslist, posted, stock_arguments)
        command = [*shlex.split(ours.ncomp), "correct", str(posted), "-o", str(output), *ncomp_options]
        _correct(command, output, folder)
        return output.read_bytes().decode("utf-8", "surrogateescape")


def _arguments(text: str) -> tuple[argparse.Namespace, list[str], list[str]]:
    """Arguments of the Job: of this post, of ncomp, and of the stock post."""
    words = shlex.split(text or "")
    end = words.index("--") if "--" in words else len(words)
    parser = argparse.ArgumentParser(prog="ncomp", add_help=False, allow_abbrev=False)
    parser.add_argument("--stock", default="linuxcnc")
    parser.add_argument("--ncomp", default=os.environ.get("NCOMP", shlex.quote(COMMAND)))
    try:
        ours, others = parser.parse_known_args(words[:end])
    except SystemExit:
        _fail(f"bad arguments {text!r}; expected {TOOLTIP_ARGS}")
    if ours.stock == "ncomp":
        _fail("--stock ncomp would call itself: name the post of the control, for example --stock linuxcnc")
    if any(word in ("-o", "--output", "--in-place") or word.startswith("--output=") for word in others):
        _fail("the output file is that of the Job: leave out -o, --output and --in-place")
    return ours, others, words[end + 1 :]


def _post(stock: str, objects: list[Any], posted: Path, arguments: list[str]) -> None:
    """Write the program of the stock post."""
    if "--no-show-editor" not in arguments:
        arguments = [*arguments, "--no-show-editor"]  # no window shows a program that is not corrected
    post = _stock_post(stock)
    joined = " ".join(shlex.quote(word) for word in arguments)
    try:
        text = post.export(_with_expected_attributes(stock, objects), str(posted), joined)
    except SystemExit:  # of its argparse, which would end FreeCAD
        _fail(f"the post {stock!r} does not accept its arguments {joined!r}")
    if not posted.exists():  # some posts return the text only
        if not isinstance(text, str) or not text:
            _fail(f"the post {stock!r} wrote nothing")
        posted.write_text(text)


def _stock_post(name: str) -> Any:
    """The module of a stock post."""
    try:
        preferences = importlib.import_module("PathScripts.PathPreferences")  # 0.19, 0.20
    except ImportError:
        preferences = importlib.import_module("Path.Preferences")  # 0.21, 1.x
    sys.path[:0] = [path for path in preferences.searchPathsPost() if path not in sys.path]
    try:
        post = importlib.reload(importlib.import_module(f"{name}_post"))  # some keep lines of the last program
    except ImportError:
        _fail(f"unknown post {name!r}: FreeCAD has {', '.join(sorted(preferences.allAvailablePostProcessors()))}")
    if not hasattr(post, "export"):
        _fail(f"{name}_post has no function export: take another post of the control")
    return post


def _with_expected_attributes(stock: str, objects: list[Any]) -> list[Any]:
    """The objects with the attributes that two posts of FreeCAD 0.20 read, and that some objects no longer have."""
    if stock == "heidenhain":
        for module in NAMED_BY_HEIDENHAIN:
            with suppress(ImportError):
                importlib.import_module(f"PathScripts.{module}")
        return [each if hasattr(each, "Proxy") else _View(each, Proxy=None) for each in objects]
    if stock == "fanuc":
        return [_with_tool_type(each) for each in objects]
    return objects


class _View:
    """An object with some attributes added or replaced; the object of the document stays unchanged."""

    def __init__(self, seen: Any, **attributes: Any) -> None:
        self.__dict__.update(attributes)
        self._seen = seen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._seen, name)


def _with_tool_type(each: Any) -> Any:
    """A tool controller, or an operation with one, whose tool has a `ToolType`."""
    controller = getattr(each, "ToolController", None)
    if controller is not None:
        return _View(each, ToolController=_with_tool_type(controller))
    tool = getattr(each, "Tool", None)
    if tool is None or hasattr(tool, "ToolType"):
        return each
    tap = str(getattr(tool, "ShapeName", "")).lower() == "tap"
    return _View(each, Tool=_View(tool, ToolType="Tap" if tap else ""))


def _correct(command: list[str], output: Path, folder: str) -> None:
    """Run ncomp; without its success there is no output. Messages are shown without the temporary folder."""
    environment = {name: value for name, value in os.environ.items() if name not in OF_FREECAD}
    try:
        done = subprocess.run(
            command,
            check=False,
            env=environment,
            cwd=output.parent,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
        )
    except OSError as fault:
        _fail(f"cannot start {command[0]}: {fault.strerror}; give the path of ncomp with --ncomp")
    except subprocess.TimeoutExpired:
        _fail(f"{command[0]} did not end within {TIMEOUT_S} s")
    shown = (done.stdout + done.stderr).replace(f"{folder}{os.sep}", "")
    if done.returncode != 0 or not output.exists():
        with suppress(FileNotFoundError):
            output.unlink()
        _fail(f"{command[0]} ended with status {done.returncode}: no program was written\n{shown}")
    FreeCAD.Console.PrintMessage(shown)


def _fail(message: str) -> NoReturn:
    """End the post with a message: FreeCAD does not count the Job as posted."""
    FreeCAD.Console.PrintError(f"ncomp post: {message}\n")
    raise RuntimeError(f"ncomp post: {message}")
