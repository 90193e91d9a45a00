"""Examiner: programs for a FANUC, with macros and subprograms in several files, by a reference interpreter."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping

from tests.fuzz import refereed
from tests.fuzz.case import Case, Outcome
from tests.fuzz.refereed import LENGTHS, MACHINES, calibration, machine_text, offsets_of, options_of, rotary_of, shipped
from tests.fuzz.words import Words
from tests.referees.fanuc import Fanuc
from tests.referees.moves import PLANES, Move

CONTROL = 'family = "fanuc"\ntool_change_moves = []'
OFFSETS = ("G54", "G55", "G56", "G57", "G58", "G59", "G54.1P1", "G54.1P2")
CENTRES = {"X": "I", "Y": "J", "Z": "K"}
PROGRAMS = 200
"""Programs of a run of the tests."""
LEAST_COMPARED = 0.75
"""Share of the programs that are compared: others need --unroll, or make blocks that it cannot write out."""


def draw(seed: int) -> Case:
    """A program and those that it calls; the machines take turns."""
    rng = random.Random(seed)
    machine, slopes = MACHINES[seed % len(MACHINES)], rng.random() < 0.5
    program, files = Program(rng, rotary_of(machine), several_holes=not slopes).texts()
    options = options_of(rng, machine, OFFSETS, unroll=slopes or rng.random() < 0.3)
    errors = calibration(machine, rng, slopes=slopes)
    return Case(program, "O0001.nc", machine_text(machine, CONTROL), errors, options, files)


def judge(case: Case) -> Outcome:
    """Correct, and run both."""
    return refereed.examine(case, run)


def run(texts: Mapping[str, str], case: Case) -> list[Move]:
    """The moves by the reference interpreter."""
    return Fanuc(texts, offsets_of(case), LENGTHS, rotary_of(shipped(case))).run()


class Program(Words):
    """Writes a program. Every statement begins and ends in G90, G94 and G17, with the axes at known places."""

    POINT = "."

    def __init__(self, rng: random.Random, rotary: str, *, several_holes: bool) -> None:
        super().__init__(rng, rotary)
        self.several_holes = several_holes
        self.inch = rng.random() < 0.15
        self.names = iter(range(1000, 9000, 7))
        self.variables = iter(range(100, 190))
        self.labels = iter(range(9000, 9999))
        self.same_file: list[str] = []
        self.files: dict[str, str] = {}

    def texts(self) -> tuple[str, dict[str, str]]:
        """The main program with subprograms behind it, and the other files by name."""
        head = ["%", "O0001 (FUZZ)", f"{'G20' if self.inch else 'G21'} G90 G17 G94 G54 G80 G40", *self.tool()]
        lines = [*head, *self.statements(self.rng.randint(2, 8), 0), "M30", *self.same_file, "%", ""]
        return "\n".join(lines), self.files

    def statements(self, number: int, level: int) -> list[str]:
        """Some statements; `level` counts those around them."""
        kinds: list[Callable[[int], list[str]]] = [
            self.moves, self.moves, self.increments, self.arcs, self.arcs, self.counted_arc, self.holes, self.holes, self.counted_holes,
            self.inverse_time, self.turned, self.formulas, self.machine,
        ]  # fmt: skip
        kinds += [self.rotary_moves, self.tool_point] if self.rotary else []
        if level < 2:
            kinds += [self.loop, self.loop, self.branch, self.subprogram, self.subprogram, self.macro]
        if level == 0:
            kinds += [
                self.offset,
                self.data,
                self.local,
                self.preset,
                self.data_in_a_loop,
                self.local_in_a_loop,
                lambda _: self.tool(),
            ]
        return [line for _ in range(number) for line in self.rng.choice(kinds)(level)]

    # ---- words

    def number(self, mm: float) -> str:
        """Text of a length; always with a point."""
        text = f"{mm / 25.4:.4f}" if self.inch else f"{mm:.3f}"
        text = text.rstrip("0") if self.rng.random() < 0.5 else text
        return "0." if text in {"-0.", "-0.000", "-0.0000"} else text

    def place(self) -> str:
        """A block that places every axis."""
        return f"G0 {self.places('XYZ' + self.rotary)}"

    # ---- statements

    def tool(self) -> list[str]:
        number = self.rng.choice(list(LENGTHS))
        return [f"T{number} M6", self.place_with(f"G43 H{number}")]

    def place_with(self, codes: str) -> str:
        return f"G90 G0 {codes} {self.places('XYZ' + self.rotary)}"

    def moves(self, _: int) -> list[str]:
        found = [f"G1 {self.places(self.some())} {self.feed()}"]
        found += [f"{self.rng.choice(('', 'G0 ', 'G1 '))}{self.places(self.some())}" for _ in range(3)]
        return [*found, *([self.place()] if self.rng.random() < 0.5 else [])]

    def increments(self, _: int) -> list[str]:
        found = [f"G91 G1 {self.places(self.some(), 9)} {self.feed()}", self.places(self.some(), 9)]
        back = self.place().replace("G0", "G90 G0") if self.rng.random() < 0.5 else f"G90 G1 {self.places('XYZ')}"
        return [*found, back]

    def arcs(self, _: int) -> list[str]:
        """An arc or two in a plane, which begin where a block has placed the axes."""
        code, plane = self.rng.choice(((17, "XY"), (17, "XY"), (18, "ZX"), (19, "YZ")))
        first, second, normal = PLANES[plane]
        start = {axis: round(self.far(), 2) for axis in "XYZ"}
        lines = [f"G{code} G1 " + " ".join(f"{a}{self.exact(v)}" for a, v in start.items()) + f" {self.feed()}"]
        sense = self.rng.choice((1, -1))
        for i in range(self.rng.randint(1, 2)):
            radius, begin = self.rng.uniform(3, 25), self.rng.uniform(0, math.tau)
            angle = self.rng.choice((self.rng.uniform(0.3, 2.6), self.rng.uniform(3.7, 5.5), math.tau))
            centre = {first: start[first] - radius * math.cos(begin), second: start[second] - radius * math.sin(begin)}
            end = {
                first: centre[first] + radius * math.cos(begin + sense * angle),
                second: centre[second] + radius * math.sin(begin + sense * angle),
            }
            inner = " ".join(f"{CENTRES[a]}{self.exact(centre[a] - start[a])}" for a in (first, second))
            words = [f"G{3 if sense > 0 else 2}"] if i == 0 else []
            if angle < math.tau:
                words += [f"{a}{self.exact(v)}" for a, v in end.items()]
                start |= end
            if self.rng.random() < 0.3:
                start[normal] += self.far(10)
                words.append(f"{normal}{self.exact(start[normal])}")
            by_radius = angle < math.tau and self.rng.random() < 0.4
            words.append(f"R{self.exact(radius if angle < math.pi else -radius)}" if by_radius else inner)
            lines.append(" ".join(words))
        return [*lines, f"G17 G0 {self.places('XYZ')}"]

    def exact(self, mm: float) -> str:
        return f"{mm / 25.4:.5f}" if self.inch else f"{mm:.4f}"

    def holes(self, _: int) -> list[str]:
        level = self.rng.uniform(20, 60)
        clear, bottom = level - self.rng.choice((0.0, 3.0, 12.5)), self.rng.uniform(-30, -1)
        code = self.rng.choice((73, 74, 76, 81, 81, 82, 83, 84, 85, 86, 89))
        more = {73: "Q2. ", 83: "Q3. ", 76: "Q0.1 P500 ", 82: "P500 ", 89: "P500 "}.get(code, "")
        back = self.rng.choice((98, 99))
        lines = [
            f"G0 {self.places('XY')} Z{self.exact(level)}",
            f"G{back} G{code} {self.places('XY')} Z{self.exact(bottom)} R{self.exact(clear)} {more}{self.feed()}",
        ]
        for _ in range(self.rng.randint(0, 3)):
            more = self.rng.choice(
                ("", "", f" Z{self.exact(bottom - 2)}", f" G{197 - back}", f" R{self.exact(clear - 1)}")
            )
            lines.append(self.places(self.some("XY")) + more)
        return [*lines, "G80", f"G0 Z{self.exact(level + 5)}", self.place()]

    def counted_holes(self, _: int) -> list[str]:
        level = self.rng.uniform(20, 60)
        code, back = self.rng.choice((81, 82, 83)), self.rng.choice((98, 99))
        lines = [
            f"G0 {self.places('XY')} Z{self.exact(level)}",
            f"G91 G{back} G{code} {self.places('XY', 9)} Z-{self.number(self.rng.uniform(5, 20))} "
            f"R-{self.number(self.rng.uniform(1, 9))} {'Q2. ' if code == 83 else ''}K{self.holes_of_a_block()} {self.feed()}",
        ]
        lines += [
            f"{self.places(self.some('XY'), 9)}{self.rng.choice(('', f' K{self.holes_of_a_block()}'))}"
            for _ in range(self.rng.randint(0, 2))
        ]
        return [*lines, "G80", f"G90 G0 Z{self.exact(level + 5)}", self.place()]

    def holes_of_a_block(self) -> int:
        """Several in one block get one correction."""
        return self.rng.randint(1, 3) if self.several_holes else 1

    def inverse_time(self, _: int) -> list[str]:
        axes = "XYZ" + self.rotary
        lines = [f"G93 G1 {self.places(self.some(axes))} F{self.rng.uniform(1, 30):.2f}" for _ in range(1)]
        lines += [
            f"{self.places(self.some(axes))} F{self.rng.uniform(1, 30):.2f}" for _ in range(self.rng.randint(1, 3))
        ]
        return [*lines, f"G94 G1 {self.places('XYZ')} {self.feed()}"]

    def turned(self, _: int) -> list[str]:
        angle = self.rng.choice((90.0, -30.0, 180.0, 12.5))
        lines = [f"G68 {self.places('XY', 20)} R{angle}", f"G0 {self.places('XYZ')}"]
        lines += [f"G1 {self.places(self.some())} {self.feed()}" for _ in range(self.rng.randint(1, 3))]
        lines += [f"G91 G1 {self.places('XY', 9)}", "G90"] if self.rng.random() < 0.4 else []
        return [*lines, "G69", self.place()]

    def rotary_moves(self, _: int) -> list[str]:
        lines = [f"G1 {self.places(self.some('XYZ' + self.rotary))} {self.feed()}" for _ in range(2)]
        lines += (
            [f"G91 G1 {self.rotary[0]}2.5 X1.", f"G90 G1 {self.places(self.rotary)}"] if self.rng.random() < 0.4 else []
        )
        return [*lines, self.place()]

    def tool_point(self, _: int) -> list[str]:
        """G43.4 with the tool of the head, and back to the length of the tool."""
        number = self.rng.choice(list(LENGTHS))
        lines = [f"T{number} M6", self.place_with(f"G43 H{number}"), "G49", f"G43.4 H{number}", self.place()]
        for _ in range(self.rng.randint(1, 4)):
            lines.append(f"G1 {self.places(self.some('XYZ' + self.rotary))} {self.feed()}")
        if self.rng.random() < 0.3:
            lines += [f"G91 G1 {self.places('XYZ', 9)}", "G90"]
        return [*lines, "G49", self.place_with(f"G43 H{number}")]

    def formulas(self, _: int) -> list[str]:
        one, two = next(self.variables), next(self.variables)
        first, second = self.number(self.far(20)), self.number(self.far(20))
        lines = [f"#{one}={first}", f"#{two}=#{one}*0.5-[{second}]"]
        words = self.rng.sample((f"X#{one}", f"Y-#{two}", f"Z[#{one}+#{two}*2]", f"X[ABS[#{two}]+1.]"), 2)
        words = words[:1] if words[0][0] == words[1][0] else words
        return [*lines, f"G1 {' '.join(words)} {self.feed()}", f"X[#{one}*COS[30.]] Y[SQRT[ABS[#{two}]]]", f"Z[#{two}]"]

    def machine(self, _: int) -> list[str]:
        if self.rng.random() < 0.5:
            return ["G91 G28 Z0.", "G90", self.place()]
        return [f"G53 G0 Z{self.number(self.rng.uniform(100, 300))}", self.place()]

    # ---- statements that set offsets

    def offset(self, level: int) -> list[str]:
        name = self.rng.choice(OFFSETS)
        lines = [self.place_with(name.replace("P", " P")), *self.statements(self.rng.randint(1, 2), level + 1)]
        return [*lines, self.place_with("G54")]

    def data(self, level: int) -> list[str]:
        number = self.rng.randint(1, 6)
        data, name = f"L2 P{number}", f"G{53 + number}"
        if number < 3 and self.rng.random() < 0.5:
            data, name = f"L20 P{number}", f"G54.1 P{number}"
        lines = [f"G90 G10 {data} {self.places('XYZ')}", self.place_with(name)]
        return [*lines, *self.statements(1, level + 1), self.place_with("G54")]

    def data_in_a_loop(self, level: int) -> list[str]:
        """The offset moves on with every iteration."""
        counter, number = next(self.variables), self.rng.randint(1, 6)
        x, y = self.number(self.far(20)), self.number(self.far(20))
        inner = self.statements(1, level + 1)
        return [
            f"#{counter}=0", f"WHILE[#{counter} LT {self.rng.randint(2, 3)}]DO1",
            f"G10 L2 P{number} X[{x}+#{counter}*5.] Y[{y}-#{counter}] Z10.", self.place_with(f"G{53 + number}"),
            *inner, f"#{counter}=#{counter}+1", "END1", self.place_with("G54"),
        ]  # fmt: skip

    def local(self, level: int) -> list[str]:
        lines = [f"G52 {self.places('XYZ', 20)}", self.place(), *self.statements(self.rng.randint(1, 2), level + 1)]
        return [*lines, "G52 X0 Y0 Z0", self.place()]

    def local_in_a_loop(self, level: int) -> list[str]:
        """A pattern of parts: the local coordinates move on with every iteration."""
        counter, x, y = next(self.variables), self.number(self.far(20)), self.number(self.far(20))
        inner = self.statements(1, level + 1)
        return [
            f"#{counter}=0", f"WHILE[#{counter} LT {self.rng.randint(2, 3)}]DO1",
            f"G52 X[{x}*#{counter}] Y[{y}-#{counter}*3.]", self.place(), *inner, f"#{counter}=#{counter}+1", "END1",
            "G52 X0 Y0", self.place(),
        ]  # fmt: skip

    def counted_arc(self, _: int) -> list[str]:
        """With G91, where end and centre count from the beginning; a second one continues it."""
        radius, turn = self.rng.uniform(2, 20), self.rng.choice((2, 3))
        inner = f"I{self.exact(radius)} J0"
        lines = [
            f"G91 G{turn} X{self.exact(radius)} Y{self.exact(radius if turn == 2 else -radius)} {inner} {self.feed()}"
        ]
        lines += [f"X{self.exact(2 * radius)} Y0 R{self.exact(1.5 * radius)}"] if self.rng.random() < 0.5 else []
        lines += [f"Z{self.number(self.far(5))} {inner}"] if self.rng.random() < 0.5 else []
        return [*lines, f"G90 G0 {self.places('XYZ')}"]

    def preset(self, _: int) -> list[str]:
        """G92, and back by the same amount, so that nothing stays."""
        axis, place, by = self.rng.choice("XYZ"), self.far(20), self.rng.uniform(1, 20)
        return [
            f"G0 {axis}{self.exact(place)}", f"G92 {axis}{self.exact(place + by)}", self.place(), *self.statements(1, 3),
            f"G0 {axis}{self.exact(place + by)}", f"G92 {axis}{self.exact(place)}", self.place(),
        ]  # fmt: skip

    # ---- the order of blocks

    def loop(self, level: int) -> list[str]:
        counter = next(self.variables)
        return [
            f"#{counter}=0", f"WHILE[#{counter} LT {self.rng.randint(1, 3)}]DO{level + 1}", self.place(),
            *self.statements(self.rng.randint(1, 2), level + 1), f"#{counter}=#{counter}+1", f"END{level + 1}",
        ]  # fmt: skip

    def branch(self, level: int) -> list[str]:
        variable, label = next(self.variables), next(self.labels)
        limit, back = self.rng.choice(("LT 2", "GE 2", "EQ 1", "NE 1", "GT 5")), next(self.labels)
        inner = self.statements(1, level + 1)
        if self.rng.random() < 0.5:
            return [f"#{variable}={self.rng.randint(0, 3)}", f"IF[#{variable} {limit}]GOTO{label}", *inner,
                    f"N{label} {self.place()}"]  # fmt: skip
        return [
            f"#{variable}=0", f"N{back} {self.place()}", *inner, f"#{variable}=#{variable}+1",
            f"IF[#{variable} GT 5]THEN #{variable}=0", f"IF[#{variable} LT 2]GOTO{back}",
        ]  # fmt: skip

    def stored(self, lines: list[str]) -> int:
        """Number of a subprogram, behind the main program or in a file of its own."""
        number = next(self.names)
        text = [f"O{number}", *lines, "M99"]
        if self.rng.random() < 0.5:
            self.same_file += text
        else:
            self.files[f"O{number}.nc"] = "\n".join(["%", *text, "%", ""])
        return number

    def subprogram(self, level: int) -> list[str]:
        number = self.stored([self.place(), *self.statements(self.rng.randint(1, 2), level + 1)])
        repeats = self.rng.choice(("", "", " L2", " L3"))
        calls = [f"M98 P{number}{repeats}" if self.rng.random() < 0.8 else f"M98 P2{number}"]
        if self.rng.random() < 0.3:
            calls += [self.place(), f"M98 P{number}"]
        return [*calls, self.place()]

    def macro(self, level: int) -> list[str]:
        lines = ["G0 X#24 Y[#25-#1]", f"G1 Z-#26 {self.feed()}", "#1=#1+1.", "X[#24+#1*2.]"]
        lines += [f"IF[#9 EQ #0]GOTO{(label := next(self.labels))}", "G1 Y[#25+#9/100.]", f"N{label} G0 Z#4"]
        number = self.stored([*lines, *self.statements(self.rng.randint(0, 1), level + 1)])
        words = f"A{self.number(self.far(9))} I{self.number(30.0)} {self.places('XYZ', 20)}"
        feed = self.rng.choice(("", " F300."))
        return [f"G65 P{number} {words}{feed}", self.place()]
