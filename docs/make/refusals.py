"""Writes docs/refusals.md: what refusals mean, with real messages, and the list of all refusals of NC programs.

python docs/make/refusals.py
"""

from __future__ import annotations

import ast
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lines import written

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "refusals.md"
HEAD = "G21 G17 G90 G94 G54\nT1 M6\nG43 H1\nG0 X0 Y0 Z60\n"
MACHINE = """name = "mill"
chain = "w X Y b Z t"
[axes.X]
travel = [0, 600]
[axes.Y]
travel = [0, 400]
[axes.Z]
travel = [0, 450]
"""


@dataclass(frozen=True)
class Example:
    """A refusal: its heading, the program and the command that show it, its meaning, and the cure."""

    heading: str
    program: str
    meaning: str
    cure: str
    command: str = "ncomp part.nc --machine dmu50 -o out.nc"
    before: str = ""


EXAMPLES = (
    Example(
        "A code that is not corrected, or not known",
        HEAD + "G31 X50. F100\nM30\n",
        "ncomp knows the code and cannot follow it, or does not know it. A wrong guess would put the tool anywhere.",
        "Write the block in another form, as the message proposes, or leave it to a program of its own. The pages "
        "[ISO](controls/iso.md), [Siemens](controls/siemens.md) and [Klartext](controls/heidenhain.md) list all codes.",
    ),
    Example(
        "A code that ncomp does not know",
        HEAD + "G234\nG1 X10. F500\nM30\n",
        "A code, cycle, call or function of the control or of the machine's builder. It may move the machine or change "
        "the coordinates.",
        "If the manual of the machine says that it moves nothing and changes no mode, accept it by name: "
        "`--pass-through G234,CYCLE977,FN33`, or `pass_through` in the [machine file](machines.md) or the "
        "[job file](job.md). Its blocks then pass unchanged, with a note; they pass without coordinates only, and no "
        "word is added to the next blocks until the program gives the positions of the axes again.",
    ),
    Example(
        "Controls differ",
        HEAD + "G76 X10. Y10. Z-5. R2. F100\nM30\n",
        "The block means one thing on one control and another on the next. ncomp does not choose.",
        'Name the control in the machine file: `family = "fanuc"` or `"linuxcnc"` under `[control]` '
        "([machine file](machines.md)).",
    ),
    Example(
        "A position that the program has not given",
        "G21 G17 G90 G94 G54\nT1 M6\nG43 H1\nG91 G1 X10. F500\nM30\n",
        "The correction depends on the position, and the program has an increment from a position that is not known.",
        "Program the axis absolutely (G90) once before.",
        command="ncomp part.nc --machine mill.toml -c none -o out.nc --work-offset G54=10,10,10 --tool-length T1=100",
    ),
    Example(
        "A work offset or a tool length is missing",
        HEAD + "G1 X10. F500\nM30\n",
        "The correction depends on where the part and the tool are, and neither the command, nor a table of the "
        "control, nor the machine file gives it.",
        "Give it by `--work-offset`, `--tool-length` or `--tool-table`, or write it into the machine file. "
        "`--set-up-zero` takes zero on purpose.",
        command="ncomp part.nc --machine mill.toml -c none -o out.nc",
    ),
    Example(
        "Outside the travel",
        HEAD + "G1 X900. F500\nM30\n",
        "The position lies beyond the travel in the machine file: the work offset, the travel or the program is wrong.",
        "Correct the one that is. `--no-travel-check` leaves the check out.",
    ),
    Example(
        "A value that the program does not contain",
        HEAD + "G1 X#100 F500\nM30\n",
        "A variable comes from the control or the operator. ncomp does not know it.",
        "Set the variable in the program ([variables](flow.md)).",
    ),
    Example(
        "A block that runs more than once",
        HEAD + "#1=0\nWHILE [#1 LT 3] DO1\nG91 G1 X100. F500\nG90\n#1=[#1+1]\nEND1\nM30\n",
        "The block has one text, and each iteration needs another correction.",
        "`--unroll` writes the iterations out.",
        command="ncomp part.nc --machine dmu50 -o out.nc --work-offset G54=-200,0,100",
    ),
    Example(
        "Already corrected",
        HEAD + "G1 X10. F500\nM30\n",
        "The program has ncomp's mark. Correcting it again would correct the same errors twice.",
        "Correct the posted program. `--force` corrects it nevertheless.",
        command="ncomp once.nc --machine dmu50 -o out.nc",
        before="ncomp part.nc --machine dmu50 -o once.nc",
    ),
    Example(
        "No calibration",
        HEAD + "G1 X10. F500\nM30\n",
        "A machine of your own has no errors until they are measured.",
        "Give the calibration, `--calibration cal.json`. `ncomp fit` makes one ([calibration](calibration.md)).",
        command="ncomp part.nc --machine mill.toml -o out.nc --set-up-zero",
    ),
    Example(
        "An implausible correction",
        HEAD + "G1 X10. F500\nM30\n",
        "A correction is larger than the errors of the calibration can be, or than the limit that was given: often a "
        "wrong unit, work offset or tool length.",
        "Look for the mistake. `--max-correction-um` sets the limit.",
        command="ncomp part.nc --machine dmu50 -o out.nc --max-correction-um 1",
    ),
    Example(
        "A file of another kind",
        "",
        "The file is no NC program.",
        "Give the right file. The message names the probable kind of the file.",
        command="ncomp data.csv --machine mill.toml -c none -o out.nc",
        before="ncomp simulate --machine mill.toml --strategy grid --points 30 -o data.csv",
    ),
    Example(
        "The calibration predicts no better than none",
        "",
        "The data do not support a calibration: it would predict points that were left out of the fit worse than no "
        "correction does. No file is written.",
        "`ncomp diagnose` looks for the cause. Check the data; measure more ([refusals of the fit]"
        "(calibration.md#refusals)).",
        command="ncomp fit data.csv --machine mill.toml -o new.json",
        before="ncomp simulate --machine mill.toml --strategy grid --points 30 --errors none -o data.csv",
    ),
)
CALLS = {"refuse", "refusal", "Refusal", "NotKnown", "Ambiguous", "NotAccepted", "accept"}
"""Calls that make the refusal of a block, with its reason."""
FOLDERS = {
    "ISO": ("postproc/iso",),
    "Siemens 840D": ("postproc/siemens",),
    "HEIDENHAIN Klartext": ("postproc/heidenhain",),
    "All dialects": ("postproc/control", "postproc/motion", "postproc/text"),
    "The correction": ("postproc/correct", "postproc/compensation", "postproc/write", "postproc/evaluation"),
}


def run(command: str, folder: Path) -> tuple[int, str]:
    """Exit status and messages of a command."""
    words = [sys.executable, "-m", "ncomp", *shlex.split(command)[1:]]
    environment = {**os.environ, "COLUMNS": "100", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def shown(example: Example) -> str:
    """The message of an example, from a run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "part.nc").write_text(example.program)
        (folder / "mill.toml").write_text(MACHINE)
        if example.before and (done := run(example.before, folder))[0] != 0:
            raise SystemExit(f"{example.heading}: {example.before}: {done[1]}")
        status, text = run(example.command, folder)
        if status != 2 or (folder / "out.nc").exists():
            raise SystemExit(f"{example.heading}: status {status}, 2 is expected\n{text}")
    return next(line for line in reversed(text.splitlines()) if line.startswith("ncomp: "))


def reasons(folders: tuple[str, ...]) -> list[str]:
    """The reasons of all refusals in the modules of some folders; … replaces a value."""
    found = set()
    for path in (path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))):
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call):
                continue
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in CALLS:
                found |= {text for text in map(_text, node.args) if len(re.findall(r"\w{2,}", text)) > 2}
    return sorted(found, key=lambda text: re.sub(r"\W", "", text).lower())


def _text(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return (_text(node.left) or "…") + (_text(node.right) or "…")
    if isinstance(node, ast.IfExp):
        return " / ".join(filter(None, (_text(node.body), _text(node.orelse))))
    return ""


def page() -> str:
    """The whole page."""
    return written(_lines())


def _lines() -> Iterator[str]:
    yield from (
        "# Refusals: their meaning and their cure",
        "",
        "Written by `python docs/make/refusals.py`; do not edit. The messages are those of real runs, and the list at "
        "the end is read from the code.",
        "",
        "A refusal is no fault: ncomp does not fully understand the program, the machine or the data, and a wrong "
        "program breaks a spindle. The exit status is 2 and there is no output file. A message names the file, the "
        "line, its text, the reason and, where there is one, the cure:",
        "",
        "    ncomp: FILE:LINE: 'TEXT': REASON: CURE",
        "",
        "`ncomp check part.nc --machine dmu50` lists all refused lines of a program at once.",
        "",
    )
    for example in EXAMPLES:
        message = shown(example)
        yield from (f"## {example.heading}", "", f"    {message}", "")
        yield from (f"**Meaning.** {example.meaning}", "", f"**Cure.** {example.cure}", "")
    yield from ("## All refusals of a block", "")
    yield (
        "Sorted by the dialect; … stands for a word or a number of the program. Reasons that belong to a single code "
        "are on the pages of the controls: [ISO](controls/iso.md), [Siemens](controls/siemens.md), "
        "[Klartext](controls/heidenhain.md)."
    )
    yield ""
    for title, folders in FOLDERS.items():
        found = reasons(folders)
        yield from (f"### {title}: {len(found)}", "", "| reason, and cure |", "|---|")
        yield from (f"| {in_table(reason)} |" for reason in found)
        yield ""


def in_table(text: str) -> str:
    """A text in a cell of a table, without a meaning of its characters."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("[", "\\[").replace("#", "\\#")


if __name__ == "__main__":
    PAGE.write_text(page())
