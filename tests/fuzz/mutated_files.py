"""Input files other than programs that somebody has spoiled: refused in words by the commands, or read.

The first option of a case is the kind of its file; `READERS` has the reader of each kind. An accepted machine,
calibration or table has to give finite numbers.
"""

from __future__ import annotations

import contextlib
import io
import random
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

from kinematics.user_error import UserError
from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.mutate import Change, files_changes, mutated
from tests.fuzz.mutated_programs import TESTS, limited
from tests.support.command import run_raising

SECONDS = 5
"""Time of the processor for one examination."""
LEAST_COMPARED = 0.05
"""Share of files that are not refused."""
NC = "G21 G90 G54 G17\nG0 X100. Y100. Z100.\nT1 M6\nG0 X100. Y100. Z100.\nG1 X130. Z90. F500\nG2 X150. Y120. I10. J10.\nM30\n"
SHARED = TESTS.parents[1] / "shared" / "data"
ROWS = 40
"""Lines of a long file that are kept."""


class File(NamedTuple):
    """A valid input."""

    kind: str
    name: str
    text: str
    more: tuple[str, ...] = ()
    """Further arguments of its reader."""


# ---- valid files


@cache
def files() -> dict[str, tuple[File, ...]]:
    """Valid files, by kind."""
    sys.path.insert(0, str(TESTS))
    found: dict[str, list[File]] = {}
    for file in [*_machines(), *_calibrations(), *_data(), *_tables(), *_tool_tables(), *_others(), *_of_pages()]:
        found.setdefault(file.kind, []).append(file)
    return {kind: tuple(each) for kind, each in found.items()}


def _machines() -> Iterable[File]:
    for path in sorted((TESTS.parent / "machines").glob("*.toml")):
        yield File("machine", path.name, path.read_text())
    more = '[control]\nfamily = "fanuc"\ntool_change_moves = ["Z"]\ninteger_words = "mm"\npassive_axes = ["E"]\n'
    offsets = "[work_offsets]\nG54 = { X = 1.0, Y = 2.0, Z = 3.0 }\n[tools]\n1 = 80.5\n"
    yield File("machine", "own.toml", (TESTS.parent / "machines" / "gantry.toml").read_text() + more + offsets)


def _calibrations() -> Iterable[File]:
    from support.effect_examples import EXAMPLES
    from support.programs import load, model_of, random_model

    from kinematics.error_model.model import encode_model

    machine = load("gantry")
    yield File("calibration", "cal.json", encode_model(random_model(machine, 3)).decode())
    for example in EXAMPLES:
        with contextlib.suppress(UserError, ValueError):
            yield File("calibration", "cal.json", encode_model(model_of(machine, example.effect)).decode())
    for path in sorted((SHARED / "nc_defects").glob("*gantry.json")):
        yield File("calibration", path.name, path.read_text())


def _data() -> Iterable[File]:
    from support.file_examples import CMM, INTERFEROMETER, LASER, MAP, PART, RTL, TRACKER, WIDE

    for text, machine in ((TRACKER, "gantry"), (INTERFEROMETER, "dmu50"), (PART, "gantry")):
        yield File("data", "data.csv", text, ("--machine", machine))
        yield File("fit", "data.csv", text, ("--machine", machine))
    for text in (RTL, WIDE, CMM, LASER):
        yield File("data", "data.rtl", text, ("--machine", "gantry"))
        yield File("iso230", "data.rtl", text, ("--machine", "gantry"))
    for path in sorted((SHARED / "ordinary_runs").glob("*.csv")):
        head = "".join(path.read_text().splitlines(keepends=True)[:ROWS])
        yield File("data", path.name, head, ("--machine", path.name.partition("-")[0]))
    yield File("map", "map.toml", MAP)
    yield File("plan", "plan.csv", _plan())
    yield File("points", "points.csv", "# target.t1: 0 0 -120\nX,Y,Z,target,dir_X\n1,2,3,t1,1\n500,20,30,t1,-1\n")
    yield File("log", "log.csv", "time_s,temp_spindle,temp_air\n0,20,21\n60,30,22.5\n120,31,20\n")


def _tables() -> Iterable[File]:
    from support.file_examples import ETALON
    from support.table_cases import CASES

    for case in CASES:
        for name, text in case.exported().files.items():
            if not name.endswith((".md", ".h")):
                sign = ("--sign", case.sign) if case.sign else ()
                yield File("import", name, text, ("--machine", case.machine, "--format", case.format, *sign))
    yield File("etalon", "etalon.txt", ETALON)


def _tool_tables() -> Iterable[File]:
    from support.file_examples import PRESETS, TNC410

    yield File("tools", "PRESET.PR", PRESETS)
    yield File("tools", "TOOL.T", TNC410)
    yield File(
        "tools",
        "ZERO.D",
        "BEGIN NULLTAB .D MM\nD    X        Y        Z\n0    +0       +0       +0\n3    +5,5     -1       +0\n[END]\n",
    )
    yield File("tools", "tool.tbl", "T1 P1 Z80.5 D6 ;mill\nT2 P2 Z120.25 D3\n")
    yield File("tools", "tools.json", '{"tools": {"1": 80.5}, "work_offsets": {"G54": {"X": 1, "Y": 2, "Z": 3}}}')
    yield File("tools", "tools.nc", "%\nO0001\nG10 L10 P1 R80.5\nG10 L11 P1 R-0.02\nG10 L2 P1 X1. Y2. Z3.\nM30\n%\n")
    yield File(
        "tools",
        "tools.arc",
        '$TC_DP3[1,1]=80.5\n$TC_DP12[1,1]=0.1\n$TC_TP2[1]="MILL"\n$P_UIFR[1]=CTRANS(X,1,Y,2,Z,3)\n',
    )


def _others() -> Iterable[File]:
    from support.file_examples import STUDY

    yield File("study", "study.toml", STUDY)
    for path in sorted((TESTS.parent / "examples").rglob("*.toml")):
        yield File("study", path.name, path.read_text())
    for name, text in _recorded().items():
        yield File("continuous", name, "".join(text.splitlines(keepends=True)[: 10 * ROWS]))


def _of_pages() -> Iterable[File]:
    from tests.fuzz import files_of_pages

    return (File(*each) for each in files_of_pages.files())


def _plan() -> str:
    return _command("plan", "--machine", "gantry", "--strategy", "hexahedron", "--points", "12", "-o", "-")


@cache
def _recorded() -> dict[str, str]:
    """A continuous run, and readings at targets of the same axis."""
    sys.path.insert(0, str(TESTS))
    from support.continuous_cases import virtual_case

    from calibration.continuous.record_file import write_records
    from calibration.continuous.virtual import Targets
    from calibration.measurement.written_file import write_measurement

    measured = virtual_case(0, targets=Targets(150.0, both=False)).measured
    run, targets = io.BytesIO(), io.BytesIO()
    write_records(measured.records, "X", "cframe", run)
    write_measurement(measured.quasi, targets)
    return {"run.csv": run.getvalue().decode(), "targets.csv": targets.getvalue().decode()}


# ---- examination


def draw(seed: int) -> Case:
    """A valid file with one to five changes."""
    rng = random.Random(seed)
    file = rng.choice(files()[rng.choice(list(files()))])
    other = rng.choice(files()[rng.choice((file.kind, rng.choice(list(files()))))])
    text = mutated(file.text, other.text, rng, files_changes())
    return Case(text.encode("latin-1", "replace").decode("latin-1"), file.name, options=(file.kind, *file.more))


def judge(case: Case) -> Outcome:
    """Let a command or a reader take the file."""
    kind, *more = case.options
    if kind == "continuous":
        _recorded()  # no part of the time of an examination
    folder = _folder()
    path = folder / case.name
    path.write_bytes(case.program.encode("latin-1"))
    try:
        with limited(SECONDS):
            READERS[kind](path, more)
    except UserError as refusal:
        message = str(refusal).replace(f"{folder}/", "")
        if len(message) < 10:
            return Outcome(Verdict.DIFFERS, f"a message without content: {message}")
        return Outcome(Verdict.REFUSED, kind)
    finally:
        for left in folder.iterdir():
            if left.name != "part.nc":
                left.unlink()
    return Outcome(Verdict.COMPARED)


def _read_machine(path: Path, _: list[str]) -> None:
    _command("machines", str(path))
    out = _command(str(path.with_name("part.nc")), "--machine", str(path), "--calibration", "none", "--no-travel-check")
    assert out == NC, "the program is not given back"


def _read_calibration(path: Path, _: list[str]) -> None:
    given = ("--calibration", str(path), "--machine", "gantry", "--elapsed", "60", "--temperature", "spindle=25")
    text = _command(str(path.with_name("part.nc")), *given)
    assert "nan" not in text.lower().partition("\n")[2], "no number"


def _read_data(path: Path, more: list[str]) -> None:
    import machines
    from calibration.measurement.readers import read_any

    read_any(path, machines.load(more[1]))


def _read_map(path: Path, _: list[str]) -> None:
    from calibration.measurement.readers.delimited import read_map

    read_map(str(path))


def _read_plan(path: Path, _: list[str]) -> None:
    import machines
    from calibration.measurement.plan_file import read_plan

    read_plan(path, machines.load("gantry"))


def _read_points(path: Path, _: list[str]) -> None:
    _command("predict", str(path), "--machine", "gantry", "--calibration", "none", "-o", "-")


def _read_log(path: Path, _: list[str]) -> None:
    from postproc.compensation.conditions import make_conditions

    make_conditions((), None, path)


def _read_study(path: Path, _: list[str]) -> None:
    from calibration.study.definition import read_study

    read_study(path)


def _read_height_map(path: Path, _: list[str]) -> None:
    from postproc.control_data.height_maps.read_map import read_map

    read_map(path, "mm")


def _read_touches(path: Path, more: list[str]) -> None:
    _command("touches", str(path), *more, "-o", "-")


def _read_etalon(path: Path, _: list[str]) -> None:
    import machines
    from postproc.control_data.formats import FORMATS

    FORMATS["etalon"].read_files(machines.load("dmu50"), {path.name: path.read_text(errors="replace")}, "error")


def _read_continuous(path: Path, _: list[str]) -> None:
    from calibration.continuous.reading import read_all

    for name, text in _recorded().items():
        if name != path.name:
            path.with_name(name).write_text(text)
    read_all([path.with_name(name) for name in _recorded()], {})


def _read_import(path: Path, more: list[str]) -> None:
    _command("import", str(path), *more, "-o", str(path.with_name("made.json")))


def _read_tools(path: Path, _: list[str]) -> None:
    out = _command(
        str(path.with_name("part.nc")), "--machine", "gantry", "--calibration", "none", "--tool-table", str(path)
    )
    assert out == NC, "the program is not given back"


def _read_iso230(path: Path, more: list[str]) -> None:
    _command("iso230", str(path), *more)


def _read_fit(path: Path, more: list[str]) -> None:
    _command("fit", str(path), *more, "--basis", "legendre:1", "-o", "-")


READERS: dict[str, Callable[[Path, list[str]], None]] = {
    "machine": _read_machine,
    "calibration": _read_calibration,
    "data": _read_data,
    "fit": _read_fit,
    "map": _read_map,
    "plan": _read_plan,
    "points": _read_points,
    "log": _read_log,
    "height-map": _read_height_map,
    "touches": _read_touches,
    "study": _read_study,
    "etalon": _read_etalon,
    "continuous": _read_continuous,
    "import": _read_import,
    "tools": _read_tools,
    "iso230": _read_iso230,
}


def _command(*arguments: str) -> str:
    """Text that a command prints; UserError where it refuses."""
    return run_raising(*arguments).out.decode("utf-8", "replace")


@cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="ncomp-files-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    (folder / "part.nc").write_text(NC)
    return folder


__all__ = ["Change", "draw", "judge"]
