"""`ncomp doctor`: check of the installation."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Literal

from kinematics.files import reason_of
from kinematics.user_error import UserError
from postproc.commands.options.shared import JsonFile, result, write_json

EPILOG = "Examples:\n\n`ncomp doctor`\n\n`ncomp doctor --json -`"
State = Literal["good", "absent", "fault"]
TITLES: dict[State, str] = {"good": "good", "absent": "absent (only some work needs it)", "fault": "FAULT"}
PROGRAM = "G21 G17 G90 G54\nT1 M6\nG0 X10. Y10. Z150. B20. C30.\nG1 X60. F500\nG2 X70. Y20. I10. J0.\nM30\n"
"""A short five-axis program, which every installation corrects."""
SETUP = ("G54=-30,-20,150",)
PROGRAMS = {"iso": PROGRAM, "siemens": "N10 G0 X=10 Y=1+2*3\n", "heidenhain": "1 L X+10 Y+QL1 R0 FMAX M3\n"}
OTHERS = {
    "LinuxCNC": (("rs274",), "its interpreter verifies programs in the tests: apt-get install linuxcnc-uspace"),
    "browser": (
        ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge"),
        "it prints pages as PDF and shows them: install Chromium",
    ),
    "FreeCAD": (("FreeCADCmd", "freecadcmd", "freecad", "FreeCAD"), "its post-processor calls ncomp (docs/cam)"),
}
"""Programs of others, by title: the names of each, and its use."""


@dataclass(frozen=True)
class Finding:
    """The end of one check."""

    check: str
    state: State
    text: str


def doctor(*, json: JsonFile) -> None:
    """Check the installation: Python, libraries, a whole correction, folders, and programs of others that ncomp uses.

    The exit status is 2 if something that ncomp needs is missing or does not work.
    """
    from postproc.commands.show.terminal import show
    from rendering.report import Report, Section, Table

    findings = list(_findings())
    faults = sum(each.state == "fault" for each in findings)
    with result(json) as file:
        write_json({"good": not faults, "checks": [asdict(each) for each in findings]}, file)
    rows = [(each.check, TITLES[each.state], each.text) for each in findings]
    verdict = f"{faults} of {len(findings)} checks show a fault." if faults else "ncomp works here."
    table = Table(("check", "result", "found"), rows)
    show(Report("Check of the installation", "", [Section("", table=table)], verdict), json)
    if faults:
        sys.exit(2)


def _findings() -> Iterator[Finding]:
    checks: dict[str, Callable[[], Finding | tuple[State, str]]] = {
        "Python": _python,
        "libraries": _libraries,
        "BLAS": _blas,
        "grammars": _grammars,
        "correction": _correction,
        "machines": _machines,
        "folders": _folders,
        "Dask": _dask,
        "completion": _completion,
    }
    for name, check in checks.items():
        try:
            end = check()
        except (UserError, OSError, ImportError) as fault:
            end = "fault", str(fault)
        except Exception as fault:  # whatever a damaged installation raises
            end = "fault", f"{type(fault).__name__}: {fault}"
        yield end if isinstance(end, Finding) else Finding(name, *end)
    yield from map(_program, OTHERS)


def _python() -> tuple[State, str]:
    import platform

    text = f"{platform.python_version()} on {platform.system()} {platform.machine()}, {sys.executable}"
    return "good", text


def _libraries() -> tuple[State, str]:
    from kinematics.running.installed import requirements

    found, wrong = [], []
    for name, least, present in requirements():
        if present is None:
            wrong.append(f"{name} is missing")
        elif _numbers(present) < _numbers(least):
            wrong.append(f"{name} {present} is older than {least}")
        else:
            found.append(f"{name} {present}")
    if wrong:
        return "fault", f"{', '.join(wrong)}: pip install --upgrade ncomp"
    return "good", ", ".join(found)


def _numbers(version: str) -> tuple[int, ...]:
    import re

    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])


def _blas() -> tuple[State, str]:
    """A system of equations whose solution is known, and the library that solves it."""
    import numpy as np
    from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

    matrix = np.random.default_rng(1).normal(size=(200, 200)) + 20.0 * np.eye(200)
    miss = float(np.abs(np.linalg.solve(matrix, matrix @ np.ones(200)) - 1.0).max())
    used = ", ".join(
        f"{each['internal_api']} {each.get('version', '')} ({each['num_threads']} threads)"
        for each in threadpool_info()
        if each["user_api"] == "blas"
    )
    return ("good" if miss < 1e-10 else "fault"), f"{used or 'built in'}; solves 200 equations to {miss:.0e}"


def _grammars() -> tuple[State, str]:
    import grammars
    import ncomp
    from postproc.correct.check import check
    from postproc.dialects import DIALECTS
    from postproc.text.source import text_source

    machine = ncomp.load_machine("dmu50")
    for name, text in PROGRAMS.items():
        setup = ncomp.set_up(machine, zero=True)
        check(text_source(text), DIALECTS[name](), machine, setup, travel_check=False)
    return "good", f"{', '.join(PROGRAMS)} from {grammars.FOLDER}"


def _correction() -> tuple[State, str]:
    """A correction and its verification by the exact model."""
    import ncomp

    setup = ncomp.set_up("dmu50", work_offset=SETUP, tool_length=("T1=80",))
    text = ncomp.correct(PROGRAM, "dmu50", setup=setup).text
    done = ncomp.verify(PROGRAM, text, "dmu50", setup=setup).verdict
    ends = f"error of a test program {done.before.largest:.1f} um before, {done.after.largest:.2f} um after"
    return ("good" if done.after.largest < 1.0 < done.before.largest else "fault"), ends


def _machines() -> tuple[State, str]:
    import machines

    names = machines.names()
    wrong = []
    for place in machines.own():
        try:
            machines.load(str(place))
        except UserError as fault:
            wrong.append(str(fault))
        if place.stem in names:
            wrong.append(
                f"{place}: {place.stem} is the name of a shipped machine, which is used in its place: rename it"
            )
    if wrong:
        return "fault", "; ".join(wrong)
    folders = ", ".join(str(folder) for folder in machines.folders())
    return "good", f"{len(names)} shipped, {len(list(machines.own()))} in {folders}"


def _folders() -> tuple[State, str]:
    """The folders that ncomp writes to: the present one, and the cache of derived chains."""
    import tempfile
    from pathlib import Path

    import platformdirs

    cache = Path(platformdirs.user_cache_dir("ncomp"))
    cache.mkdir(parents=True, exist_ok=True)
    for folder in (Path.cwd(), cache, Path(tempfile.gettempdir())):
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as fault:
            return "fault", f"cannot write to {folder}: {reason_of(fault)}"
    return "good", f"{Path.cwd()} and {cache} can be written"


def _dask() -> tuple[State, str]:
    import importlib.util

    if importlib.util.find_spec("distributed") is None:
        return "absent", "for --dask: pip install 'ncomp[dask]'"
    from importlib.metadata import version

    return "good", version("distributed")


def _completion() -> tuple[State, str]:
    from pathlib import Path

    home = Path.home()
    files = (
        home / ".bash_completions" / "ncomp.sh",
        home / ".zfunc" / "_ncomp",
        home / ".config" / "fish" / "completions" / "ncomp.fish",
    )
    found = next((path for path in files if path.is_file()), None)
    return ("absent", "ncomp --install-completion") if found is None else ("good", str(found))


def _program(title: str) -> Finding:
    """A program of others on the path."""
    import shutil

    names, use = OTHERS[title]
    found = next((path for path in map(shutil.which, names) if path), None)
    return Finding(title, "absent", use) if found is None else Finding(title, "good", found)
