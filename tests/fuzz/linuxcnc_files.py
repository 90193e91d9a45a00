"""Examiner: programs for LinuxCNC with five axes, G93, offsets in loops, and subprograms in several files."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping

from tests.fuzz import refereed
from tests.fuzz.case import Case, Outcome
from tests.fuzz.refereed import LENGTHS, MACHINES, calibration, machine_text, offsets_of, options_of, rotary_of, shipped
from tests.referees import linuxcnc
from tests.referees.moves import Move

CONTROL = 'family = "linuxcnc"\ntool_change_moves = []'
OFFSETS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
REACH = 60.0
"""Largest coordinate, mm."""
LEAST_COMPARED = 0.75
"""Share of the programs that are compared."""


def draw(seed: int) -> Case:
    """A program and those that it calls; the machines take turns."""
    rng = random.Random(seed)
    machine, slopes = MACHINES[seed % len(MACHINES)], rng.random() < 0.5
    program, files = Program(rng, rotary_of(machine), holes=not slopes).texts()
    options = options_of(rng, machine, OFFSETS, unroll=slopes or rng.random() < 0.3)
    errors = calibration(machine, rng, slopes=slopes)
    return Case(program, "main.ngc", machine_text(machine, CONTROL), errors, options, files)


def judge(case: Case) -> Outcome:
    """Correct, and run both."""
    return refereed.examine(case, run)


def run(texts: Mapping[str, str], case: Case) -> list[Move]:
    """The moves by LinuxCNC's interpreter."""
    ordered = {case.name: texts[case.name]} | dict(texts)
    return linuxcnc.run(ordered, offsets_of(case), LENGTHS, rotary_of(shipped(case)))


class Program:
    """Writes a program. Every statement begins and ends in G90 and G94, with the axes at known places."""

    def __init__(self, rng: random.Random, rotary: str, *, holes: bool) -> None:
        self.rng, self.rotary, self.holes = rng, rotary, holes
        self.labels = iter(range(100, 999))
        self.files: dict[str, str] = {}

    def texts(self) -> tuple[str, dict[str, str]]:
        """The main program, and the other files by name."""
        lines = ["G21 G90 G17 G94 G40 G80 G54", *self.tool(), *self.statements(self.rng.randint(3, 8), 0), "M2", ""]
        return "\n".join(lines), self.files

    def statements(self, number: int, level: int) -> list[str]:
        """Some statements; `level` counts those around them."""
        kinds: list[Callable[[int], list[str]]] = [self.moves, self.increments, self.arc, self.inverse_time]
        kinds += [self.rotary_moves, self.rotary_moves] if self.rotary else []
        kinds += [self.cycle] if self.holes else []
        kinds += [self.loop, self.branch, self.file, self.file] if level < 2 else []
        kinds += [self.offset, self.data_in_a_loop, lambda _: self.tool()] if level == 0 else []
        return [line for _ in range(number) for line in self.rng.choice(kinds)(level)]

    # ---- words

    def word(self, axis: str, reach: float = REACH) -> str:
        low, high = (5.0, 40.0) if axis in "ABC" else (-reach, reach)
        return f"{axis}{self.rng.uniform(low, high):.4f}"

    def places(self, axes: str, reach: float = REACH) -> str:
        return " ".join(self.word(axis, reach) for axis in axes)

    def some(self, axes: str) -> str:
        return "".join(sorted(self.rng.sample(axes, self.rng.randint(1, len(axes)))))

    def feed(self) -> str:
        return f"F{self.rng.choice((100, 250, 800))}"

    def place(self, codes: str = "G0") -> str:
        """A block that places every axis."""
        return f"{codes} {self.places('XYZ' + self.rotary)}"

    # ---- statements

    def tool(self) -> list[str]:
        number = self.rng.choice(list(LENGTHS))
        return [f"T{number} M6", f"G43 H{number}", self.place("G90 G0")]

    def moves(self, _: int) -> list[str]:
        found = [f"G1 {self.places(self.some('XYZ'))} {self.feed()}"]
        return [*found, *(f"{self.rng.choice(('', 'G0 ', 'G1 '))}{self.places(self.some('XYZ'))}" for _ in range(3))]

    def increments(self, _: int) -> list[str]:
        axes = "XYZ" + self.rotary
        return [f"G91 G1 {self.places(self.some('XYZ'), 9)} {self.feed()}", self.places("XYZ", 9), self.place("G90 G0"),
                f"G1 {self.places(axes)}"]  # fmt: skip

    def arc(self, _: int) -> list[str]:
        code, u, v, i, j = self.rng.choice(((17, *"XYIJ"), (18, *"XZIK"), (19, *"YZJK")))
        size = self.rng.uniform(3, 20)
        quarter = f"{u}{size:.4f} {v}{size:.4f}"
        words = self.rng.choice((f"{quarter} {i}{size:.4f} {j}0", f"{quarter} R{size:.4f}", f"{i}{size:.4f} {j}0"))
        return [
            f"G{code} G1 {self.places('XYZ')} {self.feed()}",
            f"G91 G{self.rng.choice((2, 3))} {words}",
            self.place("G90 G17 G0"),
        ]

    def rotary_moves(self, _: int) -> list[str]:
        axes = "XYZ" + self.rotary
        return [*(f"G1 {self.places(self.some(axes))} {self.feed()}" for _ in range(3)), self.place()]

    def inverse_time(self, _: int) -> list[str]:
        axes = "XYZ" + self.rotary
        lines = [f"G93 G1 {self.places(self.some(axes))} F{self.rng.uniform(1, 30):.2f}"]
        lines += [f"G1 {self.places(self.some(axes))} F{self.rng.uniform(1, 30):.2f}" for _ in range(2)]
        return [*lines, f"G94 {self.feed()}", f"G1 {self.places('XYZ')}"]

    def cycle(self, _: int) -> list[str]:
        back, code = self.rng.choice((98, 99)), self.rng.choice((81, 82, 83, 73, 85, 89))
        more = {82: "P0.1 ", 83: "Q3 ", 73: "Q3 ", 89: "P0.1 "}.get(code, "")
        lines = [f"G0 {self.places('XY')} Z40", f"G{back} G{code} {self.places('XY')} Z-5.5 R12.25 {more}{self.feed()}"]
        lines += [self.places(self.some("XY")) for _ in range(self.rng.randint(0, 2))]
        repeats = [f"G91 G{back} G81 {self.places('XY', 9)} Z-8 R-5 L{self.rng.randint(1, 3)}", "G80", "G90"]
        return [*lines, "G80", "G0 Z50", *(repeats if self.rng.random() < 0.5 else []), self.place()]

    # ---- offsets, loops and files

    def offset(self, level: int) -> list[str]:
        name = self.rng.choice(OFFSETS)
        return [self.place(f"{name} G0"), *self.statements(2, level + 1), self.place("G54 G0")]

    def data_in_a_loop(self, level: int) -> list[str]:
        """The offset moves on with every pass."""
        label, number = next(self.labels), self.rng.randint(1, 9)
        data = f"G10 L2 P{number} X[{self.rng.uniform(-20, 20):.3f}+#{label}*5] Y[#{label}*-3] Z10"
        return [
            f"#{label}=0", f"o{label} while [#{label} lt {self.rng.randint(2, 3)}]", data, self.place(f"{OFFSETS[number - 1]} G0"),
            *self.statements(1, level + 1), f"#{label}=[#{label}+1]", f"o{label} endwhile", self.place("G54 G0"),
        ]  # fmt: skip

    def loop(self, level: int) -> list[str]:
        label = next(self.labels)
        inner = [self.place(), *self.statements(self.rng.randint(1, 2), level + 1)]
        return [f"o{label} repeat [{self.rng.randint(1, 3)}]", *inner, f"o{label} endrepeat", self.place()]

    def branch(self, level: int) -> list[str]:
        label, condition = next(self.labels), self.rng.choice(("1 lt 2", "3 eq 4", "2 ge 2"))
        lines = [f"o{label} if [{condition}]", *self.statements(1, level + 1)]
        lines += [f"o{label} else", *self.statements(1, level + 1)] if self.rng.random() < 0.5 else []
        return [*lines, f"o{label} endif", self.place()]

    def file(self, level: int) -> list[str]:
        """A subprogram with arguments in a file of its own, called once or twice."""
        name = f"part{next(self.labels)}"
        lines = [f"o<{name}> sub", self.place(), f"G1 X#1 Y[#2*2] {self.feed()}", *self.statements(1, level + 1)]
        self.files[f"{name}.ngc"] = "\n".join([*lines, f"o<{name}> endsub", "M2", ""])
        call = f"o<{name}> call [{self.rng.uniform(-20, 20):.3f}] [{self.rng.uniform(-9, 9):.3f}]"
        return [call, *([self.place(), call] if self.rng.random() < 0.3 else []), self.place()]
