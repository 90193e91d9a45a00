"""Speed of the correcting half of ncomp in the cases that cost it most: `python benchmarks/speed_correcting.py`.

Each case is a program, or a calibration, that asks more of the correction than a smooth path does: positions beyond
the turn of a rotary axis or the calibrated range, many causes of error at once, moves that are split. It runs in turn
with the plain case; the table shows medians of several rounds, and of the ratios of processor time within a round.

    --lines 20000 --rounds 3           moves of each program
    --before CHECKOUT                  another checkout, in turn with this one
    --only split verify                some cases
    --page docs/speed.md               the page that takes the table
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from processes import Spent, spent
from speed import NCOMP, ROOT, as_markdown, conditions, note, page
from speed_inputs import Clothing, path

import machines
import ncomp
from kinematics.basis import BSpline
from kinematics.effects import Backlash, Cyclic, Effect, ErrorMotion
from kinematics.effects.combined.thermal import GrowthWithSensor
from kinematics.error_model.model import ErrorModel, write_model
from kinematics.machine import Machine

TITLE = "What costs a correction more"
ACCEPTED = ("--accept", "outside,worse,insignificant")


def turning(i: np.ndarray) -> np.ndarray:
    """The path of `speed_inputs`, half of it beyond the turn of C."""
    positions = path(i)
    positions[:, 4] += 180.0
    return positions


def beyond(i: np.ndarray) -> np.ndarray:
    """The path of `speed_inputs`, half of it beyond the travel of X, which `--no-travel-check` lets pass."""
    positions = path(i)
    positions[:, 0] += 250.0
    return positions


def far(i: np.ndarray) -> np.ndarray:
    """Long straight moves across the table, 150 mm each."""
    corners = np.array([[80.0, 60.0, 200.0, 20.0, 180.0], [-60.0, 30.0, 220.0, 20.0, 180.0]])
    positions = np.array(corners[i % 2])
    positions[:, 1] += 20.0 * np.sin(i / 400.0)
    positions[:, 2] += np.round(10.0 * np.cos(i / 300.0), 3)
    return positions


def lines_of(positions: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], Iterator[str]]:
    """Lines of straight moves to these positions."""

    def lines(i: np.ndarray) -> Iterator[str]:
        for x, y, z, b, c in positions(i).tolist():
            yield f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} B{b:.4f} C{c:.4f} F1500.\n"

    return lines


def program_of(positions: Callable[[np.ndarray], np.ndarray]) -> Clothing:
    """An ISO program of these positions."""
    x, y, z, b, c = positions(np.zeros(1, int))[0].tolist()
    head = f"G21 G17 G90 G40 G49 G80 G94 G54\nT1 M6\nS12000 M3\nG0 X{x:.4f} Y{y:.4f} Z{z:.4f} B{b:.4f} C{c:.4f}\n"
    return Clothing("", ".nc", head, lines_of(positions), "M5\nM30\n")


def measured_on_one_side(machine: Machine) -> ErrorModel:
    """The demonstration calibration, whose error motions of X are known from -250 to 0 only."""
    model = ncomp.load_calibration(machine)
    nodes = tuple(np.linspace(-250.0, 0.0, 11).tolist())
    effects = [
        ErrorMotion(effect.component, "X", BSpline(nodes, 1), (*effect.parameters, *[0.0] * 11)[:11])
        if isinstance(effect, ErrorMotion) and effect.axis == "X"
        else effect
        for effect in model.effects
    ]
    return _with_effects(model, effects)


def many_causes(machine: Machine) -> ErrorModel:
    """Cubic splines of 20 nodes for all error motions of five axes; backlash, cyclic and thermal errors beside them."""
    model, effects, random = ncomp.load_calibration(machine), list[Effect](), np.random.default_rng(1)
    for axis in machine.axes:
        low, high = axis.travel
        basis = BSpline(tuple(np.linspace(low, high, 20).tolist()), 3)
        for component in "XYZABC":
            values = tuple(random.normal(0.0, 5.0, basis.size).tolist())
            effects.append(ErrorMotion(component, axis.name, basis, values))  # type: ignore[arg-type]
        period = 20.0 if axis.rotary else 10.0
        effects.append(Cyclic(axis.name, axis.name, period=period, sine=(2.0,), cosine=(1.0,)))  # type: ignore[arg-type]
        effects.append(Backlash(axis.name, 6.0))
        if not axis.rotary:
            effects.append(GrowthWithSensor(axis=axis.name, sensor="bed", coefficient=11.0))
    return _with_effects(model, effects)


def _with_effects(model: ErrorModel, effects: Sequence[Effect]) -> ErrorModel:
    return ErrorModel(machine=model.machine, provenance=model.provenance, demonstration=True, effects=tuple(effects))


@dataclass(frozen=True)
class Case:
    """A program, and how it is corrected."""

    name: str
    program: Clothing
    calibration: Callable[[Machine], ErrorModel] | None = None
    options: tuple[str, ...] = ()
    target: str = ""
    """Of the ratio, in words."""


PLAIN = "plain"
CASES: Mapping[str, Case] = {
    PLAIN: Case("a smooth path", program_of(path)),
    "turn": Case("half of it beyond the turn of C", program_of(turning), None, ("--no-travel-check",),
                 "<= 1.2 x plain"),
    "travel": Case("half of it beyond the travel of X", program_of(beyond), None, ("--no-travel-check",),
                   "<= 1.2 x plain"),
    "outside": Case("half of it outside the calibrated range of X", program_of(path), measured_on_one_side, (),
                    "<= 1.2 x plain"),
    "causes": Case("backlash, cyclic and thermal errors, splines of 20 nodes on five axes", program_of(path),
                   many_causes, ("--temperature", "bed=24"), "<= 1.5 x plain"),
    "split": Case("long moves that are split, tolerance 1 um", program_of(far), None, (), "before / now >= 3"),
}  # fmt: skip
COMMANDS = {"verify": "<= 1.3 x plain", "check": "<= 1.3 x plain"}
"""Further commands on the plain program, with their targets."""


@dataclass(frozen=True)
class Bench:
    """A folder with programs and calibrations."""

    folder: Path
    lines: int
    calibrations: dict[str, Path] = field(default_factory=dict)

    def prepare(self, names: Sequence[str]) -> None:
        """Write programs and calibrations, and correct the plain one for `verify`."""
        machine = machines.load("dmu50")
        for name in names:
            case = CASES.get(name)
            if case is None:
                continue
            case.program.write(self.folder / f"{name}.nc", self.lines)
            if case.calibration is not None:
                self.calibrations[name] = self.folder / f"{name}.json"
                write_model(case.calibration(machine), self.calibrations[name])

    def run(self, name: str, checkout: Path) -> Spent:
        """One run of a case or of a command."""
        environment = os.environ | {"PYTHONPATH": str(checkout)}
        on = ("--machine", "dmu50", "--set-up-zero")
        if name in COMMANDS:
            programs = ("plain.nc", "plain.out.nc") if name == "verify" else ("plain.nc",)
            return spent((*NCOMP, name, *programs, *on), environment, self.folder)
        calibration = self.calibrations.get(name)
        given = () if calibration is None else ("--calibration", calibration)
        out = f"{name}.out.nc"
        words = (*NCOMP, f"{name}.nc", *on, *given, *ACCEPTED, *CASES[name].options, "-o", out)
        return spent(words, environment, self.folder)

    def written(self, name: str) -> bytes:
        """The corrected program, without its mark, which names the version of ncomp."""
        out = self.folder / f"{name}.out.nc"
        lines = out.read_bytes().splitlines(keepends=True) if out.is_file() else []
        return b"".join(line for line in lines if b"CALIBRATION" not in line)


def measured(bench: Bench, names: Sequence[str], rounds: int, before: Path | None) -> list[Sequence[str]]:
    """A row for each case."""
    now: dict[str, list[Spent]] = {name: [] for name in names}
    earlier: dict[str, list[Spent]] = {name: [] for name in names}
    same = dict.fromkeys(names, "")
    for number in range(rounds):
        for name in names:
            note(f"round {number + 1}: {name}")
            if before is not None:
                earlier[name].append(bench.run(name, before))
                old = bench.written(name)
            now[name].append(bench.run(name, ROOT))
            if before is not None and name in CASES:
                same[name] = "yes" if bench.written(name) == old else "no"
    rows: list[Sequence[str]] = []
    for name in names:
        own = [each.processor for each in now[name]]
        row = [CASES[name].name if name in CASES else f"ncomp {name}, plain program"]
        row += [f"{statistics.median(own):.2f}", f"{statistics.median(each.elapsed for each in now[name]):.2f}"]
        row.append(f"{statistics.median(a / b.processor for a, b in zip(own, now[PLAIN], strict=True)):.2f}")
        other = [each.processor for each in earlier[name]]
        row.append(f"{statistics.median(other):.2f}" if other else "")
        row.append(f"{statistics.median(a / b for a, b in zip(other, own, strict=True)):.2f}" if other else "")
        row += [same[name], CASES[name].target if name in CASES else COMMANDS[name]]
        rows.append(row)
    return rows


HEAD = ("case", "processor, s", "elapsed, s", "/ plain", "before, s", "before / now", "same output", "target")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--before", type=Path, metavar="CHECKOUT")
    parser.add_argument("--only", nargs="+", choices=[*CASES, *COMMANDS], default=[*CASES, *COMMANDS], metavar="NAME")
    parser.add_argument("--page", type=Path, metavar="FILE.md")
    given = parser.parse_args()
    names = [PLAIN, *(name for name in given.only if name != PLAIN)]
    with tempfile.TemporaryDirectory(prefix="ncomp-speed-") as folder:
        bench = Bench(Path(folder), given.lines)
        bench.prepare(names)
        rows = measured(bench, names, given.rounds, given.before and given.before.resolve())
    text = f"{given.lines:,} moves each.\n\n{as_markdown((HEAD, rows))}\n\n{conditions(given.rounds)}"
    print(text)
    if given.page is not None:
        given.page.write_text(page({TITLE: text}, given.page))


if __name__ == "__main__":
    main()
