"""Examiner: Siemens programs with variables, loops, frames, subprograms and cycles, by nc-gcode-interpreter."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping

from tests.clients import nc_gcode
from tests.fuzz import refereed
from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.refereed import LENGTHS, MACHINES, calibration, machine_text, offsets_of, options_of, rotary_of, shipped
from tests.fuzz.words import Words
from tests.referees import siemens
from tests.referees.moves import Move, Unclear

OFFSETS = ("G54", "G55", "G56", "G57")
PROGRAMS = 200
"""Programs of a run of the tests."""
LEAST_COMPARED = 0.9
"""Share of the programs that are compared."""


def draw(seed: int) -> Case:
    """A program; the machines take turns."""
    rng = random.Random(seed)
    machine, slopes = MACHINES[seed % len(MACHINES)], rng.random() < 0.5
    text, files = Program(rng, rotary_of(machine)).texts()
    options = options_of(rng, machine, OFFSETS, unroll=slopes or rng.random() < 0.3)
    errors = calibration(machine, rng, slopes=slopes)
    return Case(text, "main.mpf", machine_text(machine, "tool_change_moves = []"), errors, options, files)


def judge(case: Case) -> Outcome:
    """Correct, and run both."""
    if not nc_gcode.available():
        return Outcome(Verdict.REFUSED, "nc-gcode-interpreter is not here: .ci/run makes .nc_gcode")
    return refereed.examine(case, run, depths=False)


def run(texts: Mapping[str, str], case: Case) -> list[Move]:
    """The moves by the interpreter."""
    try:
        return siemens.run(texts, case.name, offsets_of(case), LENGTHS, rotary_of(shipped(case)))
    except nc_gcode.RefusedError as refusal:
        raise Unclear(str(refusal)) from None


class Program(Words):
    """Writes a program. Every statement begins and ends with the axes at known places, in G94, without a frame."""

    def __init__(self, rng: random.Random, rotary: str) -> None:
        super().__init__(rng, rotary)
        self.numbers = iter(range(1, 300))
        self.files: dict[str, str] = {}
        self.names = iter(f"V{chr(65 + i // 26)}{chr(65 + i % 26)}" for i in range(600))

    def texts(self) -> tuple[str, dict[str, str]]:
        """The main program, and its subprograms by file name."""
        lines = [*self.tool(), *self.statements(self.rng.randint(3, 9), 0)]
        return "\n".join(["G17 G90 G71 G94 G54", *lines, "M30", ""]), self.files

    def statements(self, number: int, level: int) -> list[str]:
        """Some statements; `level` counts those around them."""
        kinds: list[Callable[[int], list[str]]] = [
            self.moves, self.moves, self.arcs, self.arcs, self.increments, self.inverse_time, self.formulas,
            self.holes,
        ]  # fmt: skip
        kinds += [self.rotary_moves] if self.rotary else []
        kinds += [self.loop, self.loop, self.branch, self.subprogram, self.subprogram] if level < 2 else []
        if level == 0:
            kinds += [self.offset, self.frame, self.frame_in_a_loop, lambda _: self.tool()]
            kinds += [self.tool_point] if self.rotary else []
        return [line for _ in range(number) for line in self.rng.choice(kinds)(level)]

    # ---- words

    def word(self, axis: str, value: float) -> str:
        """In one of the forms that Siemens has."""
        return self.rng.choice((f"{axis}{value:.4f}", f"{axis}={value:.4f}", f"{axis}={value - 1:.4f}+2*0.5"))

    def place(self, codes: str = "G0") -> str:
        """A block that places every axis."""
        return f"{codes} {self.places('XYZ' + self.rotary)}"

    # ---- statements

    def tool(self) -> list[str]:
        return [f"T{self.rng.choice(list(LENGTHS))} M6 D1", self.place()]

    def moves(self, _: int) -> list[str]:
        found = [f"G1 {self.places(self.some())} {self.feed()}"]
        return [*found, *(f"{self.rng.choice(('', 'G0 ', 'G1 '))}{self.places(self.some())}" for _ in range(3))]

    def arcs(self, _: int) -> list[str]:
        u, v = round(self.far(), 2), round(self.far(), 2)
        lines = [f"G1 X{u} Y{v} Z{self.far():.3f} {self.feed()}"]
        for _ in range(self.rng.randint(1, 2)):
            radius, begin, sense = self.rng.uniform(3, 25), self.rng.uniform(0, math.tau), self.rng.choice((1, -1))
            angle = self.rng.choice((self.rng.uniform(0.3, 2.6), self.rng.uniform(3.7, 5.5)))
            i, j = -radius * math.cos(begin), -radius * math.sin(begin)
            x, y = u + i + radius * math.cos(begin + sense * angle), v + j + radius * math.sin(begin + sense * angle)
            by_radius = self.rng.random() < 0.4
            centre = f"CR={radius if angle < math.pi else -radius:.4f}" if by_radius else f"I{i:.4f} J{j:.4f}"
            lines.append(f"G{3 if sense > 0 else 2} X{x:.4f} Y{y:.4f} {centre}")
            u, v = x, y
        return [*lines, self.place()]

    def increments(self, _: int) -> list[str]:
        lines = [f"G1 {self.places('XYZ')} {self.feed()}"]
        lines += [" ".join(f"{a}=IC({self.far(9):.3f})" for a in self.some()) for _ in range(2)]
        return [*lines, self.place()]

    def inverse_time(self, _: int) -> list[str]:
        axes = "XYZ" + self.rotary
        lines = [f"G93 G1 {self.places(self.some(axes))} F{self.rng.uniform(1, 30):.2f}"]
        lines += [
            f"{self.places(self.some(axes))} F{self.rng.uniform(1, 30):.2f}" for _ in range(self.rng.randint(1, 3))
        ]
        return [*lines, f"G94 G1 {self.places('XYZ')} {self.feed()}"]

    def formulas(self, _: int) -> list[str]:
        one, two = (f"R{next(self.numbers)}" for _ in range(2))
        lines = [f"{one}={self.far(20):.3f}"]
        lines += [f"{two}={one}*0.5-({self.far(9):.3f})", f"G1 X={one} Y=-{two} {self.feed()}"]
        return [*lines, f"Z=({one}+{two})*2 X={one}/2", f"Y={two}-{one}*1.5", self.place()]

    def rotary_moves(self, _: int) -> list[str]:
        return [*(f"G1 {self.places(self.some('XYZ' + self.rotary))} {self.feed()}" for _ in range(2)), self.place()]

    def tool_point(self, _: int) -> list[str]:
        lines = ["TRAORI", self.place()]
        lines += [
            f"G1 {self.places(self.some('XYZ' + self.rotary))} {self.feed()}" for _ in range(self.rng.randint(1, 4))
        ]
        return [*lines, "TRAFOOF", self.place()]

    def holes(self, _: int) -> list[str]:
        """A cycle at each of some positions."""
        level, clear, depth = self.rng.uniform(20, 60), self.rng.choice((0, 2, 3.5)), self.rng.uniform(-20, -1)
        code, more = self.rng.choice(((81, ""), (82, ",0,0.5"), (85, ",0,0.1,100,300")))
        lines = [f"G0 {self.places('XY')} Z{level:.3f}", f"MCALL CYCLE{code}({level:.3f},0,{clear},{depth:.3f}{more})"]
        lines += [
            f"G0 {self.word('X', self.far())} {self.word('Y', self.far())}" for _ in range(self.rng.randint(1, 3))
        ]
        return [self.feed(), *lines, "MCALL", self.place()]

    def subprogram(self, level: int) -> list[str]:
        """In a file of its own, which is called once or several times."""
        name = f"SUB{next(self.numbers)}"
        lines = [self.place(), *self.statements(self.rng.randint(1, 2), level + 1)]
        self.files[f"{name}.SPF"] = "\n".join([*lines, self.rng.choice(("M17", "RET")), ""])
        call = self.rng.choice((name, name, f'CALL "{name}"', f"{name} P{self.rng.randint(1, 3)}"))
        return [call, *([self.place(), name] if self.rng.random() < 0.3 else []), self.place()]

    def offset(self, level: int) -> list[str]:
        name = self.rng.choice(OFFSETS)
        return [self.place(f"{name} G0"), *self.statements(self.rng.randint(1, 2), level + 1), self.place("G54 G0")]

    def frame(self, level: int) -> list[str]:
        lines = [f"TRANS {self.places('XYZ', 20)}", self.place(), *self.statements(1, level + 1)]
        if self.rng.random() < 0.5:
            lines += [f"ATRANS {self.places(self.some(), 9)}", self.place(), *self.statements(1, level + 1)]
        return [*lines, "TRANS", self.place()]

    def frame_in_a_loop(self, level: int) -> list[str]:
        counter = next(self.names)
        inner = [f"ATRANS X={self.far(9):.3f} Y={counter}*2", self.place(), *self.statements(1, level + 1)]
        return [
            f"DEF INT {counter}",
            f"FOR {counter}=1 TO {self.rng.randint(2, 3)}",
            *inner,
            "ENDFOR",
            "TRANS",
            self.place(),
        ]

    def loop(self, level: int) -> list[str]:
        counter = next(self.names)
        inner = [self.place(), f"G1 X={counter}*1.5+{abs(self.far(9)):.3f} {self.feed()}"]
        inner += self.statements(self.rng.randint(1, 2), level + 1)
        if self.rng.random() < 0.5:
            return [f"DEF INT {counter}", f"FOR {counter}=1 TO {self.rng.randint(1, 3)}", *inner, "ENDFOR"]
        return [
            f"DEF INT {counter}=0",
            f"WHILE {counter}<{self.rng.randint(1, 3)}",
            *inner,
            f"{counter}={counter}+1",
            "ENDWHILE",
        ]

    def branch(self, level: int) -> list[str]:
        name, sign = next(self.names), self.rng.choice(("<", ">", "==", "<>", ">=", "<="))
        lines = [f"DEF REAL {name}={self.rng.randint(0, 3)}", f"IF {name}{sign}2", *self.statements(1, level + 1)]
        lines += ["ELSE", *self.statements(1, level + 1)] if self.rng.random() < 0.5 else []
        return [*lines, "ENDIF", self.place()]
