"""Writes docs/results: the keys and columns of the results for programs, from real runs, by subject.

    python docs/make/results.py

Every command that has `--json` runs once, on the files of the tutorial and simulated data. The keys, their types
and examples come from these runs; `meanings.py` explains names.
"""

from __future__ import annotations

import csv
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lines import written
from meanings import MEANINGS, UNITS

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "results"
INPUTS = ROOT / "postproc" / "tutorial"
CIRCLES = "--instrument ballbar --centre 300,200,150 --target t1=0,0,-120 --bar 100:0.5 --feed 1000"
STUDY = """machine = "gantry"
draws = 2
[instrument]
kind = "laser-tracker"
u_range_um_per_m = 0.5
u_angle_um = 3
[errors]
model = "table-1"
[[case]]
name = "grid"
strategy = "grid"
points = 40
tracker = [-1500, 1500, 300]
"""
TESTS = [("ranging", 2000, far, "", um) for far, um in ((4000, 0.9), (6000, -1.2), (10000, 1.4), (20000, 3.1))]
TESTS += [("length", far, "", 2300, um) for far, um in ((2000, 9), (4000, -14), (6000, 18), (10000, -31))]
TESTS += [("two-face", far, "", "", um) for far, um in ((2000, 14), (2000, 20), (5000, 30), (9000, 41))]
BEFORE = (
    f"ncomp simulate --machine mill.toml {CIRCLES} --effect backlash:axis=X,width=8 -o circles.csv",
    "ncomp simulate --machine mill.toml --strategy axes --spacing 100 --runs 3 --instrument interferometer -o runs.csv",
    "ncomp simulate-continuous --machine mill.toml --axis X --start-mm 0 --end-mm 450 --feed 5000 --rate 1000 --spacing 45 "
    "--both -o run.csv --quasistatic targets.csv",
)
RESULTS = {
    "correct": "ncomp part.nc --machine mill.toml -c true.json -o part_c.nc --json -",
    "batch": "ncomp batch posted corrected --machine mill.toml -c true.json --jobs 1 --json -",
    "verify": "ncomp verify part.nc part_c.nc --machine mill.toml -c true.json --json -",
    "check": "ncomp check part.nc --machine mill.toml --json -",
    "fit": "ncomp fit measured.csv --machine mill.toml -o first.json --json -",
    "diagnose": "ncomp diagnose measured.csv --machine mill.toml -o cal.json --json -",
    "predict": "ncomp predict points.csv --machine mill.toml -c cal.json -o predicted.csv --json -",
    "compare": "ncomp compare first.json cal.json --machine mill.toml --json -",
    "export": "ncomp export --machine mill.toml -c cal.json --format linuxcnc -o tables --json -",
    "export of kinematic parameters": "ncomp export --machine dmu50 --format fanuc-kinematics -o parameters --json -",
    "iso230": "ncomp iso230 runs.csv --machine mill.toml --json -",
    "ballbar": "ncomp ballbar circles.csv --machine mill.toml --json -",
    "continuous": "ncomp continuous run.csv targets.csv -o table.csv --json -",
    "study": "ncomp study study.toml -o results.csv --workers 1 --json -",
    "tracker": "ncomp tracker b89.csv --json -",
}
"""The run of each command; its JSON is the standard output."""
SUBJECTS = {
    "programs": ("Programs", ("correct", "batch", "verify", "check")),
    "fits": ("Fits and diagnoses", ("fit", "diagnose")),
    "calibrations": ("Calibrations", ("predict", "compare", "export", "export of kinematic parameters")),
    "evaluations": ("Evaluations and studies", ("iso230", "ballbar", "continuous", "study", "tracker")),
}
"""Title of each page, and its commands."""
COLUMNS = "columns"
"""Page of the columns of CSV files."""
SHOWN_AT = {("batch", "programs[].result"): "correct"}
"""Keys with the JSON of another command, which has a section of its own."""
TABLES = {
    "plan": ("plan.csv", "ncomp plan points --machine mill.toml --strategy random --points 20 -o plan.csv"),
    "simulate": ("data.csv", "ncomp simulate --machine mill.toml --strategy plan.csv -o data.csv"),
    "predict": ("predicted.csv", ""),
    "continuous": ("table.csv", ""),
    "study": ("results.csv", ""),
}
"""Files with columns, and the run that writes them, if none of RESULTS does."""


def run(command: str, folder: Path) -> str:
    """Standard output of a command."""
    words = [sys.executable, "-m", "ncomp", *shlex.split(command)[1:]]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{command}: status {done.returncode}\n{done.stderr}")
    return done.stdout


def prepare(folder: Path) -> None:
    """The inputs of all runs."""
    for path in INPUTS.iterdir():
        shutil.copyfile(path, folder / path.name)
    (folder / "posted").mkdir()
    shutil.copyfile(INPUTS / "part.nc", folder / "posted" / "part.nc")
    (folder / "points.csv").write_text("X,Y,Z\n0,0,0\n300,200,225\n")
    (folder / "study.toml").write_text(STUDY)
    with (folder / "b89.csv").open("w") as file:
        csv.writer(file).writerows([("test", "range_mm", "range_2_mm", "length_mm", "error_um"), *TESTS])
    for command in BEFORE:
        run(command, folder)


def results(folder: Path) -> dict[str, Any]:
    """The JSON of each command."""
    return {name: json.loads(run(command, folder)) for name, command in RESULTS.items()}


def columns(folder: Path) -> dict[str, list[str]]:
    """The columns of each file; the files of RESULTS are there already."""
    found = {}
    for name, (file, command) in TABLES.items():
        if command:
            run(command, folder)
        head = next(line for line in (folder / file).read_text().splitlines() if not line.startswith("#"))
        found[name] = head.split(",")
    return found


def keys(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The paths of all keys of a JSON value, with the first value of each; `[]` is any entry of a list."""
    if isinstance(value, dict):
        for key, inner in value.items():
            name = "NAME" if path.endswith("inputs") else key  # names of files
            own = f"{path}.{name}" if path else name
            yield own, inner
            yield from keys(inner, own)
    elif isinstance(value, list):
        for inner in value:
            if isinstance(inner, (dict, list)):
                yield from keys(inner, f"{path}[]")


def key_table(value: Any, command: str = "") -> dict[str, Any]:
    """The paths of keys, each once; keys below names of axes, errors or lines count once.

    Keys below one with the JSON of another command are left out.
    """
    found: dict[str, Any] = {}
    elsewhere = tuple(f"{path}." for of, path in SHOWN_AT if of == command)
    for path, inner in keys(value):
        if not general(path).startswith(elsewhere or (" ",)):
            found.setdefault(general(path), inner)
    return found


def general(path: str) -> str:
    """A path with NAME for keys that are names: of axes, error motions, work offsets and the like."""
    named = re.compile(r"^(?:E_\w+|[A-Z]\d*|G\d+(?:\.\d+)?|\d[\w.-]*|[XYZABC]{2}|.*[ ,+/()-].*)$")
    return ".".join("NAME" if named.match(part.removesuffix("[]")) else part for part in path.split("."))


def kind(value: Any) -> str:
    """The type of a value in words."""
    names = {bool: "true or false", int: "number", float: "number", str: "text", list: "list", dict: "object"}
    return "null or a value" if value is None else names[type(value)]


def example(value: Any) -> str:
    """A short example of a value."""
    if isinstance(value, (dict, list)) or value is None:
        return ""
    text = f"{value:.4g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
    return f"`{text[:40]}`".replace("|", "\\|") if text != '""' else ""


def meaning(path: str) -> str:
    """The meaning of a key, with its unit."""
    name = path.rsplit(".", maxsplit=1)[-1].removesuffix("[]")
    unit = next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}") or name == end), "")
    return ", ".join(filter(None, (MEANINGS.get(name, ""), unit)))


def pages() -> dict[str, str]:
    """The pages by name."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        found = results(folder)
        tables = columns(folder)
    texts = {"index": _index(), COLUMNS: _columns(tables)}
    for subject, (title, commands) in SUBJECTS.items():
        texts[subject] = _subject(title, {command: found[command] for command in commands})
    return {name: written(lines) for name, lines in texts.items()}


def _index() -> Iterator[str]:
    yield from (
        "# Results for programs: JSON and CSV",
        "",
        "`--json FILE` writes the result of a command for other programs, `--json -` to standard output. The unit is the "
        "end of a name: `_um`, `_urad`, `_mm`, `_s`. Uncertainties in JSON are standard uncertainties (k=1). A dot "
        "separates levels, `[]` is an entry of a list, and NAME is the name of an axis, an error motion, a work "
        "offset or a file.",
        "",
        "The keys of `diagnose` that are explained here, and the columns of measurement files, are a contract: they stay.",
        "",
        "| page | JSON of |",
        "|---|---|",
    )
    for subject, (title, commands) in SUBJECTS.items():
        linked = (f"[{command}]({subject}.md#json-of-{command.replace(' ', '-')})" for command in commands)
        yield f"| [{title}]({subject}.md) | {', '.join(linked)} |"
    yield f"| [Columns of CSV files]({COLUMNS}.md) | {', '.join(TABLES)} |"
    yield ""
    yield (
        "These pages are written by `python docs/make/results.py` from real runs; do not edit them. A test compares the "
        "keys with new runs."
    )
    yield ""


def _subject(title: str, found: dict[str, Any]) -> Iterator[str]:
    """The page of some commands; found: their JSON."""
    yield from (f"# Results: {title}", "", "How to read these tables: [results](index.md).", "")
    for command, value in found.items():
        yield from (f"## JSON of {command}", "", f"    {RESULTS[command]}", "", "| key | type | example | meaning |")
        yield "|---|---|---|---|"
        for path, inner in key_table(value, command).items():
            other = SHOWN_AT.get((command, path))
            text = f"the [JSON of {other}](#json-of-{other})" if other else meaning(path)
            yield f"| `{path}` | {kind(inner)} | {example(inner)} | {text} |"
        yield ""


def _columns(tables: dict[str, list[str]]) -> Iterator[str]:
    yield from ("# Columns of CSV files", "")
    yield (
        "Lines that begin with `#` are a header, `# key: value`. [Measurement files](../measurements/index.md) have their "
        "own pages."
    )
    yield ""
    for command, names in tables.items():
        yield from (f"## {command}", "", "| column | meaning |", "|---|---|")
        yield from (f"| `{name}` | {meaning(name)} |" for name in names)
        yield ""


if __name__ == "__main__":
    PAGES.mkdir(exist_ok=True)
    for name, text in pages().items():
        (PAGES / f"{name}.md").write_text(text)
