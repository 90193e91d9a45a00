"""Examiner: Klartext programs, with labels, parameters, cycles and called files, by a reference interpreter."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Mapping

from tests.fuzz import refereed
from tests.fuzz.case import Case, Outcome
from tests.fuzz.refereed import LENGTHS, MACHINES, calibration, machine_text, offsets_of, options_of, rotary_of, shipped
from tests.fuzz.words import Words
from tests.referees.klartext import Klartext
from tests.referees.moves import Move

PRESETS = ("0", "1", "2")
PROGRAMS = 200
"""Programs of a run of the tests."""
LEAST_COMPARED = 0.75
"""Share of the programs that are compared: others need --unroll, or make blocks that it cannot write out."""


def draw(seed: int) -> Case:
    """A program and those that it calls; the machines take turns."""
    rng = random.Random(seed)
    machine, slopes = MACHINES[seed % len(MACHINES)], rng.random() < 0.5
    program, files = Program(rng, rotary_of(machine), most_deg=290.0 if slopes else 700.0).texts()
    options = options_of(rng, machine, PRESETS, unroll=slopes or rng.random() < 0.3)
    errors = calibration(machine, rng, slopes=slopes)
    return Case(program, "main.h", machine_text(machine, "tool_change_moves = []"), errors, options, files)


def judge(case: Case) -> Outcome:
    """Correct, and run both."""
    return refereed.examine(case, run, depths=False, between=True)


def run(texts: Mapping[str, str], case: Case) -> list[Move]:
    """The moves by the reference interpreter."""
    presets = {int(name): offset for name, offset in offsets_of(case).items()}
    return Klartext(texts, presets, LENGTHS, rotary_of(shipped(case))).run()


class Program(Words):
    """Writes a program. Every statement begins and ends with the axes at known places."""

    SIGN = "+"

    def __init__(self, rng: random.Random, rotary: str, *, most_deg: float) -> None:
        super().__init__(rng, rotary)
        self.most_deg = most_deg
        self.inch, self.comma = rng.random() < 0.15, rng.random() < 0.2
        self.numbered = rng.random() < 0.5
        self.names, self.parameters, self.labels = iter(range(1, 99)), iter(range(1, 90)), iter(range(1, 400))
        self.behind: list[str] = []
        self.files: dict[str, str] = {}

    def texts(self) -> tuple[str, dict[str, str]]:
        """The main program with subprograms behind its end, and the other files by name."""
        lines = [*self.tool(), *self.statements(self.rng.randint(2, 8), 0), "L M30", *self.behind]
        return self.text("MAIN", lines), self.files

    def text(self, name: str, lines: list[str]) -> str:
        """The text of a file."""
        unit = "INCH" if self.inch else "MM"
        lines = [
            line
            for block in (f"BEGIN PGM {name} {unit}", *lines, f"END PGM {name} {unit}")
            for line in block.split("\n")
        ]
        if self.numbered:
            numbers = iter(range(len(lines)))
            lines = [line if line.startswith("  ") else f"{next(numbers)} {line}" for line in lines]
        text = "\n".join([*lines, ""])
        return re.sub(r"(?<=\d)\.(?=\d)", ",", text) if self.comma and "CYCL" not in text else text

    def statements(self, number: int, level: int) -> list[str]:
        """Some statements; `level` counts those around them."""
        kinds: list[Callable[[int], list[str]]] = [
            self.moves, self.moves, self.increments, self.arcs, self.arcs, self.polar, self.helix, self.tangent,
            self.holes, self.holes, self.turned, self.counted, self.formulas, self.machine, self.corner,
        ]  # fmt: skip
        kinds += [self.rotary_moves, self.tool_point] if self.rotary else []
        if level < 2:
            kinds += [self.repeat, self.repeat, self.branch, self.subprogram, self.subprogram, self.file]
        if level == 0:
            kinds += [self.preset, self.shift, self.shift_in_a_loop, self.turned_in_a_loop, lambda _: self.tool()]
        return [line for _ in range(number) for line in self.rng.choice(kinds)(level)]

    # ---- words

    def number(self, mm: float) -> str:
        """Text of a length, with its sign."""
        return f"{mm / 25.4:+.5f}" if self.inch else f"{mm:+.4f}"

    def place(self) -> str:
        """A block that places every axis."""
        return f"L {self.places('XYZ' + self.rotary)} R0 FMAX"

    def at(self, p: tuple[float, float]) -> str:
        return f"X{self.number(p[0])} Y{self.number(p[1])}"

    def start(self) -> tuple[tuple[float, float], list[str]]:
        """A place at which X, Y and Z stand."""
        at = round(self.far(), 2), round(self.far(), 2)
        return at, [f"L {self.at(at)} Z{self.number(self.far())} {self.feed()}"]

    # ---- statements

    def tool(self) -> list[str]:
        return [f"TOOL CALL {self.rng.choice(list(LENGTHS))} Z S2000", self.place()]

    def moves(self, _: int) -> list[str]:
        found = [f"L {self.places(self.some())} {self.feed()}"]
        found += [f"L {self.places(self.some())}{self.rng.choice(('', ' FMAX', ' R0 F400', ' M8'))}" for _ in range(3)]
        return [*found, *([self.place()] if self.rng.random() < 0.5 else [])]

    def increments(self, _: int) -> list[str]:
        return [f"L {self.places(self.some(), 9, 'I')} {self.feed()}", f"L {self.places(self.some(), 9, 'I')}",
                f"L IX+1 {self.places('Z')}", f"L {self.places('XYZ')}"]  # fmt: skip

    def arcs(self, _: int) -> list[str]:
        at, lines = self.start()
        for _ in range(self.rng.randint(1, 2)):
            radius, begin, sense = self.rng.uniform(3, 25), self.rng.uniform(0, math.tau), self.rng.choice((1, -1))
            angle = self.rng.choice((self.rng.uniform(0.3, 2.6), self.rng.uniform(3.7, 5.5), math.tau))
            centre = round(at[0] - radius * math.cos(begin), 3), round(at[1] - radius * math.sin(begin), 3)
            radius, begin = math.dist(at, centre), math.atan2(at[1] - centre[1], at[0] - centre[0])
            end = (
                centre[0] + radius * math.cos(begin + sense * angle),
                centre[1] + radius * math.sin(begin + sense * angle),
            )
            turn = "DR+" if sense > 0 else "DR-"
            if angle < math.tau and self.rng.random() < 0.4:
                lines.append(f"CR {self.at(end)} R{self.number(radius if angle < math.pi else -radius)} {turn}")
            elif self.rng.random() < 0.5:
                lines += [f"CC {self.at(centre)}", f"C {self.at(end)} {turn}"]
            else:
                lines += [
                    f"CC IX{self.number(centre[0] - at[0])} IY{self.number(centre[1] - at[1])}",
                    f"C {self.at(end)} {turn}",
                ]
            at = (end[0], end[1]) if angle < math.tau else at
        return [*lines, self.place()]

    def polar(self, _: int) -> list[str]:
        lines = [
            self.place(),
            f"CC {self.places('XY', 20)}",
            f"LP PR{self.number(self.rng.uniform(5, 40))} PA{self.angle()} {self.feed()}",
        ]
        for _ in range(self.rng.randint(1, 3)):
            word = self.rng.choice(
                (f"PA{self.angle()}", f"IPA{self.angle()}", f"PR{self.number(self.rng.uniform(5, 40))}")
            )
            lines.append(f"LP {word}{self.rng.choice(('', f' Z{self.number(self.far())}'))}")
        return [*lines, self.place()]

    def helix(self, _: int) -> list[str]:
        """CP by an angle, with Z or not; one of more than 300 degrees may end beside its corrected end (docs/flow.md)."""
        at, lines = self.start()
        centre = at[0] + self.far(20), at[1] + self.rng.uniform(5, 20)
        sense, angle = self.rng.choice("+-"), self.rng.uniform(20, self.most_deg)
        rise = self.rng.choice(("", f" IZ{self.number(self.far(9))}", f" Z{self.number(self.far())}"))
        if self.rng.random() < 0.3:
            rise, words = "", f"PA{self.angle()}"
        else:
            words = f"IPA{sense}{angle:.4f}"
        return [*lines, f"CC {self.at(centre)}", f"CP {words}{rise} DR{sense}", self.place()]

    def tangent(self, _: int) -> list[str]:
        _, lines = self.start()
        lines += [f"L I{'X'}{self.number(12.0)} IY{self.number(self.far(9))}"]
        lines += [f"CT IX{self.number(15.0)} IY{self.number(self.rng.choice((8.0, -8.0, 14.0)))}"]
        return [*lines, self.place()]

    def corner(self, _: int) -> list[str]:
        _, lines = self.start()
        size = 1.0 / 25.4 if self.inch else 1.0
        breaks = self.rng.choice((f"RND R{size:.4f}", f"CHF {size:.4f}"))
        lines += [f"L IX{self.number(15.0)}", breaks, f"L IY{self.number(15.0)}"]
        return [*lines, self.place()]

    def holes(self, _: int) -> list[str]:
        clear, second = self.rng.choice(((2.0, 2.0), (3.0, 40.0), (2.0, 25.0)))
        scale = 1 / 25.4 if self.inch else 1.0
        number = self.rng.choice((200, 201, 203, 240))
        surface = self.far(20) * scale
        words = [f"Q200={clear * scale:.4f}", f"Q201=-{self.rng.uniform(2, 20) * scale:.4f}", f"Q203={surface:+.4f}",
                 f"Q204={second * scale:.4f}"]  # fmt: skip
        words += {200: ["Q206=150", f"Q202={5 * scale:.4f}", "Q210=0", "Q211=0"], 201: ["Q206=150", "Q211=0", "Q208=500"],
                  203: ["Q206=150", f"Q202={5 * scale:.4f}", "Q210=0", "Q212=0", "Q213=0", "Q205=0", "Q211=0", "Q208=500", "Q256=0.2"],
                  240: ["Q343=0", "Q344=0", "Q206=150", "Q211=0"]}[number]  # fmt: skip
        lines = [
            f"L Z{self.number(70.0)} R0 FMAX",
            f"CYCL DEF {number} DRILL ~\n" + " ~\n".join(f"  {w} ;A" for w in words),
        ]
        for _ in range(self.rng.randint(1, 3)):
            call = self.rng.choice((" M99", "\nCYCL CALL", "\nCYCL CALL M8"))
            lines.append(f"L {self.places(self.some('XY'))} R0 FMAX{call}")
        return [*lines, f"L Z{self.number(80.0)} R0 FMAX", self.place()]

    def turned(self, _: int) -> list[str]:
        """About a shifted datum."""
        angle = self.rng.choice((90.0, -30.0, 180.0, 12.5))
        lines = ["CYCL DEF 10.0 ROTATION", f"CYCL DEF 10.1 ROT{angle:+}", self.place()]
        lines += [f"L {self.places(self.some())} {self.feed()}" for _ in range(self.rng.randint(1, 3))]
        lines += [f"L {self.places('XY', 9, 'I')}"] if self.rng.random() < 0.4 else []
        lines += self.polar(0) if self.rng.random() < 0.4 else []
        return [*lines, "CYCL DEF 10.0 ROTATION", "CYCL DEF 10.1 ROT+0", self.place()]

    def turned_in_a_loop(self, _: int) -> list[str]:
        """A pattern on a circle: the rotation goes on by an increment."""
        label, angle = next(self.labels), self.rng.choice((30, 72, -45))
        lines = [f"LBL {label}", self.place(), f"L {self.places('XY')} {self.feed()}", *self.arcs(0)[:-1]]
        lines += ["CYCL DEF 10.0 ROTATION", f"CYCL DEF 10.1 IROT{angle:+}", self.place()]
        lines += [f"CALL LBL {label} REP{self.rng.randint(1, 3)}"]
        return [*lines, "CYCL DEF 10.0 ROTATION", "CYCL DEF 10.1 ROT+0", self.place()]

    def counted(self, _: int) -> list[str]:
        """Arcs and polar moves by increments, and a feed by a parameter."""
        size, sense = self.rng.uniform(3, 15), self.rng.choice("+-")
        name = f"Q{next(self.parameters)}"
        lines = [f"{name} = {self.rng.choice((300, 450))}", self.place(), f"L {self.places('XY', 9, 'I')} F{name}"]
        lines += [f"CR IX{self.number(size)} IY{self.number(size / 3)} R{self.number(size)} DR{sense}"]
        lines += [
            f"CC IX{self.number(size)} IY{self.number(0.0)}",
            f"C IX{self.number(size)} IY{self.number(size)} DR{sense}",
        ]
        lines += [f"LP IPR{self.number(2.0)} IPA{sense}20", f"LP IPA{self.angle()} IZ{self.number(self.far(5))}"]
        return [*lines, f"CP IPA{sense}{self.rng.uniform(10, 200):.3f} DR{sense}", self.place()]

    def rotary_moves(self, _: int) -> list[str]:
        lines = [f"L {self.places(self.some('XYZ' + self.rotary))} {self.feed()}" for _ in range(2)]
        lines += (
            [f"L I{self.rotary[0]}+2.5 IX+1", f"L {self.places('XYZ' + self.rotary)}"]
            if self.rng.random() < 0.4
            else []
        )
        return [*lines, self.place()]

    def tool_point(self, _: int) -> list[str]:
        lines = ["L M128", self.place()]
        for _ in range(self.rng.randint(1, 4)):
            lines.append(f"L {self.places(self.some('XYZ' + self.rotary))} {self.feed()}")
        lines += [f"L {self.places('XYZ', 9, 'I')}"] if self.rng.random() < 0.3 else []
        return [*lines, "L M129", self.place()]

    def formulas(self, _: int) -> list[str]:
        kind = self.rng.choice(("Q", "QL"))
        one, two, three = (f"{kind}{next(self.parameters)}" for _ in range(3))
        first, second = self.number(self.far(20)), self.number(self.far(20))
        lines = [f"{one} = {first}", f"FN {self.rng.choice('123')}: {two} = {one} * +2".replace("* +2", "* +1.5")]
        lines[1] = self.rng.choice(
            (f"FN 1: {two} = +{one} + {second}", f"FN 2: {two} = +{one} - {second}", f"FN 3: {two} = +{one} * +0.5")
        )
        lines += [
            self.rng.choice(
                (
                    f"{three} = {one} * 0.5 + ( {two} - 3 ) * COS 30",
                    f"FN 6: {three} = SIN +30",
                    f"FN 8: {three} = +3 LEN +4",
                )
            )
        ]
        return [*lines, f"L X+{one} Y-{two} {self.feed()}", f"L Z+{three}", f"L X-{two} IY+{three}", self.place()]

    def machine(self, _: int) -> list[str]:
        return [f"L Z+{self.rng.uniform(100, 300) * (1 / 25.4 if self.inch else 1):.3f} R0 FMAX M91", self.place()]

    # ---- statements that set the datum

    def preset(self, level: int) -> list[str]:
        chosen = "CYCL DEF 247 DATUM SETTING ~\n  Q339={} ;NUMBER"
        inner = self.statements(self.rng.randint(1, 2), level + 1)
        return [chosen.format(self.rng.choice("012")), self.place(), *inner, chosen.format(0), self.place()]

    def datum(self, words: list[str]) -> list[str]:
        return ["CYCL DEF 7.0 DATUM SHIFT", *(f"CYCL DEF 7.{i} {word}" for i, word in enumerate(words, 1))]

    def shift(self, level: int) -> list[str]:
        lines = [*self.datum(self.places("XYZ", 20).split()), self.place(), *self.statements(1, level + 1)]
        if self.rng.random() < 0.4:
            lines += [
                *self.datum(self.places(self.some(), 5, "I").split()),
                self.place(),
                *self.statements(1, level + 1),
            ]
        return [*lines, *self.datum(["X+0", "Y+0", "Z+0"]), self.place()]

    def shift_in_a_loop(self, level: int) -> list[str]:
        label = next(self.labels)
        lines = [
            f"LBL {label}",
            *self.datum([f"IX{self.number(self.far(9))}", f"IY{self.number(self.far(9))}"]),
            self.place(),
        ]
        lines += [*self.statements(1, level + 1), f"CALL LBL {label} REP {self.rng.randint(1, 2)}"]
        return [*lines, *self.datum(["X+0", "Y+0", "Z+0"]), self.place()]

    # ---- the order of blocks

    def repeat(self, level: int) -> list[str]:
        label = next(self.labels)
        inner = self.statements(self.rng.randint(1, 2), level + 1)
        return [
            f"LBL {label}",
            self.place(),
            *inner,
            f"CALL LBL {label} REP{self.rng.choice(('', ' '))}{self.rng.randint(1, 2)}",
        ]

    def branch(self, level: int) -> list[str]:
        parameter, label = f"Q{next(self.parameters)}", next(self.labels)
        inner = self.statements(1, level + 1)
        number, sign = self.rng.choice(((9, "EQU"), (10, "NE"), (11, "GT"), (12, "LT")))
        if self.rng.random() < 0.5:
            return [f"{parameter} = {self.rng.randint(0, 2)}", f"FN {number}: IF +{parameter} {sign} +1 GOTO LBL {label}",
                    *inner, f"LBL {label}", self.place()]  # fmt: skip
        return [f"FN 0: {parameter} = +0", f"LBL {label}", self.place(), *inner, f"FN 1: {parameter} = +{parameter} + +1",
                f"FN 12: IF +{parameter} LT +2 GOTO LBL {label}"]  # fmt: skip

    def subprogram(self, level: int) -> list[str]:
        label = next(self.labels)
        inner = self.statements(self.rng.randint(1, 2), level + 1)
        self.behind += [f"LBL {label}", self.place(), *inner, "LBL 0"]
        calls = [f"CALL LBL {label}", *([self.place(), f"CALL LBL {label}"] if self.rng.random() < 0.4 else [])]
        return [*calls, self.place()]

    def file(self, level: int) -> list[str]:
        name = f"SUB{next(self.names)}"
        behind, self.behind = self.behind, []
        lines = [self.place(), *self.statements(self.rng.randint(1, 2), level + 1)]
        if self.behind:  # labels belong to their file, and M2 would end the caller
            lines, self.behind = [self.place()], []
        self.behind = behind
        self.files[f"{name.lower()}.h"] = self.text(name, lines)
        calls = [
            f"CALL PGM {name.lower()}",
            *([self.place(), f"CALL PGM {name.lower()}.h"] if self.rng.random() < 0.3 else []),
        ]
        return [*calls, self.place()]
