"""Speed of the correction beside other readers of NC programs: `python benchmarks/speed.py [--page docs/speed.md]`.

Programs of a million moves in several clothings are made, and corrected by ncomp for the shipped DMU 50, in turn with
LinuxCNC's interpreter `rs274 -g`, which only reads them. Beside these, pygcode and a parse of every line by the
grammar alone (Lark) read the first lines, and ncomp corrects programs of growing length and the largest real ones.
Tables show medians of several rounds, and medians of the ratios within a round: all of a round run one after the other.

    --lines 10000000 --rounds 1        the largest size
    --lines 5000 --rounds 1            a small version, for CI
    --before CHECKOUT                  another checkout (`git worktree add ../before COMMIT`), for comparisons with it
    --only real commands               some tables; a page keeps the others as they are
    --pygcode FOLDER                   where `pip install --target FOLDER pygcode` has put it; needed for nothing else
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import before_after
import cold_start
import numpy as np
from plain_share import WITH_A, errors_of, lines_in_bulk, machine_of
from processes import Failed, Spent, spent
from speed_inputs import CLOTHINGS, FIVE_AXES, Clothing

import machines
from kinematics.error_model.model import write_model
from kinematics.user_error import UserError

ROOT = Path(__file__).parents[1]
REAL = ROOT.parent / "shared" / "data" / "nc"
LARGEST_REAL = 5
GROWTH = (1_000, 10_000, 100_000, 1_000_000)
FIRST = FIVE_AXES
"""The form of growing programs, and of those that other readers read."""
READ = 10_000
"""Number of lines that slow readers read."""
NCOMP = (sys.executable, "-c", "from postproc.cli import run; run()")
PYGCODE = """
import sys, time
folder, path, most = sys.argv[1:]
sys.path.append(folder)
from pygcode import Line
with open(path) as file:
    lines = [line.rstrip("\\n") for line, _ in zip(file, range(int(most)))]
start = time.perf_counter()
for line in lines:
    Line(line)
print((time.perf_counter() - start) / len(lines) * 1e6)
"""
LARK = """
import sys, time
from grammars import block_parser
folder, path, most = sys.argv[1:]
parser = block_parser("iso")
with open(path) as file:
    lines = [line.rstrip("\\n") for line, _ in zip(file, range(int(most)))]
start = time.perf_counter()
for line in lines:
    parser.parse(line)
print((time.perf_counter() - start) / len(lines) * 1e6)
"""
Table = tuple[Sequence[str], list[Sequence[str]]]


@dataclass(frozen=True)
class Bench:
    """A folder for programs, and the commands that are measured."""

    folder: Path
    rounds: int
    pygcode: str

    def correct(self, program: Path, machine: str = "dmu50", *options: str, checkout: Path = ROOT) -> Spent:
        """The correction of a program by the calibration of the machine."""
        words = (
            *NCOMP,
            program,
            "--machine",
            machine,
            "--set-up-zero",
            "-o",
            self.folder / f"out{program.suffix}",
            *options,
        )
        return spent(words, os.environ | {"PYTHONPATH": str(checkout)}, self.folder)

    def interpret(self, program: Path) -> Spent | None:
        """Reading by LinuxCNC's interpreter; None where it is not installed or refuses the program."""
        if shutil.which("rs274") is None:
            return None
        tools, offsets = self.folder / "tools.tbl", self.folder / "offsets.var"
        tools.write_text("".join(f"T{n} P{n} D0 Z0\n" for n in range(1, 100)))
        numbers = [5220, *(5221 + 20 * k + i for k in range(9) for i in range(10))]
        offsets.write_text("".join(f"{n} {float(n == 5220)}\n" for n in numbers))
        environment = {"HOME": str(self.folder), "PATH": os.environ["PATH"], "LC_ALL": "C.UTF-8"}
        try:
            return spent(("rs274", "-g", "-t", tools, "-v", offsets, program), environment, self.folder)
        except Failed:
            return None

    def us_a_line(self, code: str, program: Path) -> float | None:
        """Time of another reader, us a line, without its start; None where it is not installed."""
        words = [sys.executable, "-c", code, self.pygcode, str(program), str(READ)]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        return float(done.stdout) if done.returncode == 0 else None

    def written(self, clothing: Clothing, lines: int, *, for_linuxcnc: bool = False) -> Path:
        """A program of so many moves."""
        path = self.folder / f"{'its' if for_linuxcnc else 'in'}{clothing.suffix}"
        clothing.write(path, lines, clothing.own_head if for_linuxcnc else None)
        return path


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=int, default=1_000_000, help="moves of a program")
    parser.add_argument("--forms", type=int, default=50_000, metavar="MOVES", help="of each form before and after")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--pygcode", default="", metavar="FOLDER")
    parser.add_argument("--real", type=Path, default=REAL, metavar="FOLDER", help="real programs")
    parser.add_argument("--before", type=Path, metavar="CHECKOUT", help="another checkout, to compare with")
    parser.add_argument("--only", nargs="+", choices=TABLES, default=TABLES, metavar="NAME", help=" ".join(TABLES))
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="page to write, docs/speed.md")
    given = parser.parse_args()
    before, lines = given.before and given.before.resolve(), given.lines
    sections = {}
    with tempfile.TemporaryDirectory(prefix="ncomp-speed-") as folder:
        bench = Bench(Path(folder), given.rounds, given.pygcode)
        bench.correct(bench.written(CLOTHINGS[FIRST], 10))  # writes Python's compiled files
        makers: dict[str, tuple[str, Callable[[], Table]]] = {
            "forms": (f"{lines:,} moves", lambda: clothings(bench, lines)),
            "growth": ("From short to long", lambda: growth(bench, [n for n in GROWTH if n < lines] + [lines])),
            "start": ("Start", lambda: cold_start.table(cold_start.RUNS)),
            "readers": ("Other readers", lambda: readers(bench)),
        }
        if given.real.is_dir():
            makers["real"] = "Real programs", lambda: real_programs(bench, given.real.resolve(), before)
        if before:
            makers["forms before"] = "Forms, before and after", lambda: forms_before(bench, before, given.forms)
            makers["commands"] = "Commands, before and after", lambda: commands(before, given.rounds)
        for name in (name for name in makers if name in given.only):
            title, make = makers[name]
            rounds = cold_start.RUNS if name == "start" else given.rounds
            sections[title] = f"{as_markdown(make())}\n\n{conditions(rounds)}"
            print(f"## {title}\n\n{sections[title]}\n", flush=True)
    if given.page is not None:
        given.page.write_text(page(sections, given.page))


TABLES = ("forms", "forms before", "growth", "start", "readers", "real", "commands")
"""Names of the tables, in the order of the page."""


def page(sections: dict[str, str], path: Path) -> str:
    """The page with these sections, by title, and with those of the present page that are not measured again."""
    present = re.split(r"^## (.*)\n", path.read_text(), flags=re.MULTILINE)[1:] if path.is_file() else []
    kept = {title: text.strip() for title, text in zip(present[::2], present[1::2], strict=True)}
    if any(title.endswith(" moves") for title in sections):
        kept = {title: text for title, text in kept.items() if not title.endswith(" moves")}
    order = ("moves", "Steps", "Forms", "costs", "short", "Start", "Other", "Real", "Commands")
    titles = sorted(kept | sections, key=lambda title: next(i for i, word in enumerate(order) if word in title))
    return "\n\n".join([INTRODUCTION.rstrip(), *(f"## {t}\n\n{(kept | sections)[t]}" for t in titles)]) + "\n"


def clothings(bench: Bench, lines: int) -> Table:
    """Every form of the program, beside LinuxCNC's reading of it."""
    rows: dict[str, list[tuple[Spent, Spent | None]]] = {name: [] for name in CLOTHINGS}
    for number in range(bench.rounds):
        interpreted: dict[str, Spent | None] = {}
        for name, clothing in CLOTHINGS.items():
            note(f"round {number + 1}: {name}")
            its, moves = CLOTHINGS[clothing.twin or name], min(lines, clothing.most)
            if its is clothing or moves < lines:
                interpreted[name] = bench.interpret(bench.written(its, moves, for_linuxcnc=True))
            done = bench.correct(bench.written(clothing, moves), "dmu50", *clothing.options)
            rows[name].append((done, interpreted[name if name in interpreted else its.name]))
    return HEAD, [(name, *figures(pairs, min(lines, CLOTHINGS[name].most))) for name, pairs in rows.items()]


def forms_before(bench: Bench, before: Path, lines: int) -> Table:
    """Processor time of every form in another checkout and in this one, and of LinuxCNC's reading."""
    before_after.write_bytecode(before)
    rows: dict[str, list[tuple[Spent, Spent, Spent | None]]] = {name: [] for name in CLOTHINGS}
    for number in range(bench.rounds):
        for name, clothing in CLOTHINGS.items():
            note(f"round {number + 1}, before and after: {name}")
            its, moves = CLOTHINGS[clothing.twin or name], min(lines, clothing.most)
            interpreted = bench.interpret(bench.written(its, moves, for_linuxcnc=True))
            program, options = bench.written(clothing, moves), ("dmu50", *clothing.options)
            earlier = bench.correct(program, *options, checkout=before)
            rows[name].append((earlier, bench.correct(program, *options), interpreted))
    head = ("form", "moves", "processor before, s", "now, s", "before / now", "rs274 -g, s")
    return head, [(n, f"{min(lines, CLOTHINGS[n].most):,}", *before_and_after(done)) for n, done in rows.items()]


def before_and_after(done: Sequence[tuple[Spent, Spent, Spent | None]]) -> Iterator[str]:
    """Medians of processor times before and after, of their ratio, and of those of LinuxCNC."""
    pairs = [(earlier, now) for earlier, now, _ in done]
    yield f"{before_after.median([earlier for earlier, _ in pairs], 1):.2f}"
    yield f"{before_after.median([now for _, now in pairs], 1):.2f}"
    yield f"{before_after.ratio(pairs):.1f}"
    theirs = [each[2] for each in done if each[2] is not None]
    yield f"{before_after.median(theirs, 1):.2f}" if theirs else ""


def growth(bench: Bench, sizes: Sequence[int]) -> Table:
    """One form in several lengths: time and memory."""
    rows: dict[int, list[tuple[Spent, Spent | None]]] = {size: [] for size in sizes}
    for number in range(bench.rounds):
        for size in sizes:
            note(f"round {number + 1}: {size:,} moves")
            program = bench.written(CLOTHINGS[FIRST], size)
            rows[size].append((bench.correct(program), bench.interpret(program)))
    return (f"moves, {FIRST}", *HEAD[1:]), [(f"{size:,}", *figures(pairs, size)) for size, pairs in rows.items()]


def readers(bench: Bench) -> Table:
    """Other readers of the first lines."""
    program = bench.written(CLOTHINGS[FIRST], READ)
    names = {"pygcode, Line()": PYGCODE, "Lark, the grammar alone": LARK}
    found: dict[str, list[float | None]] = {name: [] for name in names}
    for number in range(bench.rounds):
        for name, code in names.items():
            note(f"round {number + 1}: {name}")
            found[name].append(bench.us_a_line(code, program))
    rows: list[Sequence[str]] = []
    for name, times in found.items():
        known = [time for time in times if time is not None]
        rows.append((name, f"{statistics.median(known):.1f}" if known else "not installed: --pygcode FOLDER"))
    return (f"reader of {READ:,} lines", "us a line"), rows


def real_programs(bench: Bench, folder: Path, before: Path | None) -> Table:
    """The largest real programs that ncomp corrects, those for a machine with A on a virtual one; and all together."""
    options = ("--no-travel-check", "--accept", "outside,worse")
    calibration = bench.folder / "virtual.json"
    write_model(errors_of(machines.load(WITH_A)), calibration)
    paths = [path for path in folder.rglob("*") if path.is_file()]
    bulk = {path: found for path in paths if (found := share_in_bulk(path)) is not None}
    rows: list[Sequence[str]] = []
    for path in sorted(bulk, key=lambda path: -bulk[path][1])[:LARGEST_REAL]:
        name, (fast, lines) = machine_of(path), bulk[path]
        words = (name, *(("--calibration", str(calibration)) if name == WITH_A else ()), *options)
        done: list[tuple[Spent, Spent | None]] = []
        old: list[tuple[Spent, Spent]] = []
        for number in range(bench.rounds):
            note(f"round {number + 1}: {path.name}")
            if before:
                earlier = bench.correct(path, *words, checkout=before)
            done.append((bench.correct(path, *words), bench.interpret(path)))
            if before:
                old.append((earlier, done[-1][0]))
        now, others = [own for own, _ in done], [other for _, other in done if other is not None]
        shown = [f"{before_after.median(now, 1):.2f}", "", ""]
        if old:
            shown[1:] = [f"{before_after.median([each for each, _ in old], 1):.2f}", f"{before_after.ratio(old):.1f}"]
        shown += [f"{max(own.peak_mb for own in now):.0f}", f"{before_after.median(others, 1):.2f}" if others else ""]
        rows.append((path.name, f"{lines:,}", f"{fast / lines:.1%}", *shown))
    fast, lines = np.sum(list(bulk.values()), axis=0).tolist()
    rows.append((f"all {len(bulk)} that are corrected", f"{lines:,}", f"{fast / lines:.1%}", *[""] * 5))
    head = ("processor, s", "before, s", "before / now", "memory, MB", "rs274 -g, processor, s")
    return ("program", "lines", "in bulk", *head), rows


def share_in_bulk(path: Path) -> tuple[int, int] | None:
    """Lines that are corrected in bulk, and all lines; None for a program that is refused."""
    machine = machines.load(machine_of(path))
    try:
        return lines_in_bulk(path, machine, errors_of(machine))
    except UserError:
        return None


def commands(before: Path, rounds: int) -> Table:
    """Commands of another checkout and of this one."""
    sizes = before_after.Sizes()
    times, same = before_after.measured(before, list(before_after.COMMANDS), rounds, sizes)
    rows: list[Sequence[str]] = []
    for name, pairs in times.items():
        earlier, now = ([pair[k] for pair in pairs] for k in (0, 1))
        shown = [f"{before_after.median(each, column):.{digits}f}" for column, digits in ((1, 2), (0, 1), (2, 0))
                 for each in (earlier, now)]  # fmt: skip
        rows.append((name, *shown[:2], f"{before_after.ratio(pairs):.1f}", *shown[2:], "yes" if same[name] else "no"))
    head = (
        "processor before, s",
        "now, s",
        "before / now",
        "elapsed before, s",
        "now, s",
        "memory before, MB",
        "now, MB",
    )
    return ("command", *head, "same output"), rows


HEAD = ("form", "ncomp, s", "processor, s", "us a line", "memory, MB", "rs274 -g, s", "times as fast as rs274")


def figures(pairs: Sequence[tuple[Spent, Spent | None]], lines: int) -> Iterator[str]:
    """Medians of ncomp and of LinuxCNC, and of their ratio."""
    own = [done for done, _ in pairs]
    elapsed = statistics.median(done.elapsed for done in own)
    yield f"{elapsed:.2f}"
    yield f"{statistics.median(done.processor for done in own):.2f}"
    yield f"{elapsed / lines * 1e6:.2f}"
    yield f"{max(done.peak_mb for done in own):.0f}"
    both = [(done.elapsed, other.elapsed) for done, other in pairs if other is not None]
    yield f"{statistics.median(other for _, other in both):.2f}" if both else ""
    yield f"{statistics.median(other / done for done, other in both):.2f}" if both else ""


def as_markdown(table: Table) -> str:
    """The table for a page."""
    head, rows = table
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def conditions(rounds: int) -> str:
    """Sentences on the computer."""
    return (
        f"Medians of {rounds} round{'s' * (rounds > 1)} on {os.cpu_count()} cores ({platform.machine()}), load "
        f"{os.getloadavg()[0]:.1f} at the end; Python {platform.python_version()}, NumPy {np.__version__}."
    )


def note(text: str) -> None:
    """Show what is being measured."""
    print(text, file=sys.stderr, flush=True)


INTRODUCTION = """\
# Speed

`make speed` writes this page: `python benchmarks/speed.py --page docs/speed.md`. Do not edit it.

Programs of one smooth path, in the clothings that CAM systems post, are corrected by ncomp for the shipped DMU 50 and
its demonstration calibration: read, corrected, checked and written, with the start of the process. For long programs
two further processes read ahead and evaluate the corrections. In turn with it LinuxCNC's interpreter, in C++, only
reads the same moves (`rs274 -g`). Ratios are those within a round. Memory is that of all processes together. The
start is that of a short job beside a process that only imports NumPy (`benchmarks/cold_start.py`).

Lines in bulk are read, moved and written in columns, together with the lines around them. The others are read one by
one: comments, cycles but for the positions of G81 to G89, M functions, arcs among increments (G91), and moves that
are split.
All lines of a program count (`benchmarks/plain_share.py`). Before: another checkout, run in turn with this one
(`--before CHECKOUT`, also `benchmarks/before_after.py`). The times of forms hold the start of the process. `verify`
reads two programs of 200,000 blocks, `fit` 3,000 rows, `diagnose` 300. `benchmarks/speed_steps.py` writes the table of
steps, `benchmarks/speed_correcting.py` that of what costs more.
"""

if __name__ == "__main__":
    main()
