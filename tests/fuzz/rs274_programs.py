"""Random RS274/NGC programs: as shops write them, and as nobody writes them. Shares nothing with other generators."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable

PLANES = {17: ("X", "Y", "Z"), 18: ("Z", "X", "Y"), 19: ("Y", "Z", "X")}
CENTRES = {"X": "I", "Y": "J", "Z": "K"}
OFFSETS = ("54", "55", "56", "57", "58", "59", "59.1", "59.2", "59.3")
TOOLS = (1, 2, 3)
MM_PER_INCH = 25.4


class Style:
    """Style of one program: mostly one habit, sometimes any form."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.odd = rng.random() < 0.4
        self.lower = rng.random() < 0.2
        self.gap = rng.choice([" ", " ", " ", "", "\t", "  "])
        self.numbered = rng.random() < 0.3
        self.zeros = rng.random() < 0.3
        self.end = rng.choice(["\n", "\n", "\n", "\r\n"])
        self.number = 0

    def value(self, value: float, decimals: int = 4) -> str:
        """Text of a number; its value when read is `round(value, decimals)`."""
        text = f"{round(value, decimals):.{decimals}f}".rstrip("0")
        text = text.removesuffix(".") if self.rng.random() < 0.3 else text
        text = "0" if text in {"-0", "-0."} else text
        if self.zeros and "." in text:
            text += "0" * self.rng.randint(0, 3)
        if not self.odd or self.rng.random() < 0.6:
            return text
        sign, digits = ("-", text[1:]) if text.startswith("-") else ("", text)
        match self.rng.randrange(60):
            case form if form < 15 and not sign:
                sign = "+"
            case form if form < 30:
                digits = digits.zfill(len(digits) + self.rng.randint(1, 2))
            case form if form < 45 and digits.startswith("0.") and len(digits) > 2:
                digits = digits[1:]
            case 59:
                place = self.rng.randint(0, len(digits))
                digits = digits[:place] + self.rng.choice([" ", "\t"]) + digits[place:]
            case _:
                pass
        return sign + digits

    def code(self, letter: str, number: str) -> str:
        """A G or M word."""
        digits, dot, tenth = number.partition(".")
        if self.odd and self.rng.random() < 0.3:
            digits = digits.zfill(2)
        return f"{letter}{digits}{dot}{tenth}"

    def block(self, words: Iterable[str], *, skip: bool = False, keep: bool = False) -> str:
        """A line of words, in any order unless `keep`."""
        words = list(words)
        if self.odd and not keep and self.rng.random() < 0.4:
            self.rng.shuffle(words)
        if self.odd and self.rng.random() < 0.15:
            words.insert(self.rng.randint(0, len(words)), self.rng.choice(["(a note)", "( X5 Y7 )", "()", "(G1, F3)"]))
        if self.numbered and not skip:
            self.number += self.rng.choice([1, 5, 10])
            words.insert(0, f"N{self.number}")
        gap = self.gap if not self.odd else self.rng.choice([self.gap, " ", "", "  "])
        text = gap.join(words)
        text = text if not self.lower else _lowered(text)
        if self.rng.random() < 0.05:
            text += self.rng.choice(["(end)", " (half) (more)"])
        elif self.rng.random() < 0.002:
            text += self.rng.choice([" ; X1 Y2", ";note"])
        if self.odd and self.rng.random() < 0.05:
            text = " " + text + "  "
        return ("/" if skip else "") + text + self.end


def _lowered(text: str) -> str:
    out, depth = [], 0
    for c in text:
        depth += (c == "(") - (c == ")")
        out.append(c if depth else c.lower())
    return "".join(out)


class Program:
    """Writes one program; holds the programmed positions, mm, in the active coordinates. None: not known."""

    def __init__(self, seed: int, *, contours: bool, plain: bool) -> None:
        self.rng = rng = random.Random(seed)
        self.style = Style(rng)
        self.contours, self.plain = contours, plain
        self.out: list[str] = []
        self.unit, self.absolute, self.plane, self.centres = 1.0, True, 17, False
        self.motion: str | None = None
        self.at: dict[str, float | None] = dict.fromkeys("XYZ")
        self.known: dict[str, float] = {}
        self.per_minute = True
        self.labels = 100
        self.simple = False
        self.turned = False

    def text(self) -> str:
        """The whole program."""
        self._head()
        for _ in range(self.rng.randint(3, 16)):
            self.rng.choice(self._statements())()
        self._end()
        text = "".join(self.out)
        if self.rng.random() < 0.15:
            text = "%" + self.style.end + text + "%" + self.style.end
        return text

    def _head(self) -> None:
        rng, put = self.rng, self.put
        for line in rng.sample(["(part 12)", "", "; made by hand", "(T1 = 8 mm)"], rng.randint(0, 2)):
            self.out.append(line + self.style.end)
        self.unit = MM_PER_INCH if rng.random() < 0.2 else 1.0
        codes = ["G20" if self.unit > 1 else "G21", "G90", "G17"]
        codes += rng.sample(["G40", "G49", "G80", "G94", "G61", "G91.1", "G98"], rng.randint(0, 5))
        if rng.random() < 0.5:
            put(codes)
        else:
            put(codes[:2])
            put(codes[2:])
        if rng.random() < 0.3:
            put(["T1", "M6"])
            put(["G43", "H1"])
        put([f"G{rng.choice(OFFSETS)}"] if rng.random() < 0.5 else ["G54"])
        put(["F" + self.style.value(rng.choice([100, 250.5, 600, 1200]) / self.unit, 3)])
        if rng.random() < 0.3:
            put(["S1200", "M3"])
        if rng.random() < 0.93:
            self.place()

    def _end(self) -> None:
        if not self.simple:
            self.put([self.rng.choice(["M2", "M30", "M02"])])

    def _statements(self) -> list[Callable[[], None]]:
        simple = [self.move] * 8 + [self.arc] * 4 + [self.increments, self.dwell, self.switch, self.assign, self.same]
        if self.simple:
            return simple
        rare = [
            self.modes, self.turn_plane, self.units, self.distance, self.frame, self.frame, self.preset, self.shift,
            self.set_data, self.machine_move, self.reference, self.tool, self.drill, self.drill, self.polar,
            self.inverse_time, self.branch, self.loop, self.call, self.note, self.formula, self.formula, self.place,
            self.skip, self.blank, self.seldom,
        ]  # fmt: skip
        if self.plain:
            return [
                *simple,
                self.place,
                self.machine_move,
                self.preset,
                self.frame,
                self.drill,
                self.turn_plane,
                self.modes,
            ]
        return simple + rare + ([self.contour] * 12 if self.contours else [])

    # --- words

    def put(self, words: Iterable[str], *, keep: bool = False, skip: bool = False) -> None:
        """Write a block."""
        self.out.append(self.style.block(words, keep=keep, skip=skip))

    @property
    def decimals(self) -> int:
        return 4 if self.unit == 1.0 else 5

    def coordinate(self, mm: float) -> tuple[str, float]:
        """Text of a coordinate in the unit in force, and the mm that it reads back as."""
        value = round(mm / self.unit, self.decimals)
        if self.known and self.rng.random() < 0.15:
            name, part = self.rng.choice(list(self.known.items()))
            rest = round(value - part, self.decimals)
            form = self.rng.randrange(3)
            if form == 0:
                return f"[{name}{rest:+.{self.decimals}f}]", (part + rest) * self.unit
            if form == 1:
                return f"[{rest:.{self.decimals}f} + {name} * 1]", (part + rest) * self.unit
            return f"[[{name} - {-rest:.{self.decimals}f}]]".replace("- -", "+ "), (part + rest) * self.unit
        return self.style.value(value, self.decimals), value * self.unit

    def axis(self, name: str, target: float) -> str:
        """A word that moves to `target` in mm, as an increment or not; the position is then known."""
        here = self.at[name]
        if self.absolute:
            text, self.at[name] = self.coordinate(target)
        else:
            text, moved = self.coordinate(target - (here if here is not None else self.rng.uniform(-200, 200)))
            self.at[name] = here + moved if here is not None else None
        return name + text

    def g(self, number: str) -> list[str]:
        """A motion code, left out now and then where it is in force."""
        if self.motion == number and self.rng.random() < 0.6:
            return []
        self.motion = number
        return [self.style.code("G", number)]

    def random_target(self) -> float:
        return round(self.rng.choice([1, 10, 100, 100, 300]) * self.rng.uniform(-1, 1), self.rng.randint(0, 4))

    # --- motions

    def place(self) -> None:
        """A rapid that names every axis."""
        words = self.g("0")
        before, self.absolute = self.absolute, True
        if not before:
            words.append("G90")
        self.put(words + [self.axis(name, self.random_target()) for name in "XYZ"])

    def move(self) -> None:
        words = self.g(self.rng.choice(["0", "1", "1", "1"]))
        chosen = self.rng.sample("XYZ", self.rng.choice([1, 1, 2, 2, 3]))
        words += [self.axis(name, self.random_target()) for name in chosen]
        if self.motion == "1" and (self.rng.random() < 0.15 or not self.per_minute):
            words.append("F" + self.style.value(self.rng.choice([80, 300, 1500.5]) / self.unit, 3))
        self.put(words)

    def same(self) -> None:
        """A move to the present position of the tool, or a motion code alone."""
        name = self.rng.choice("XYZ")
        if self.at[name] is not None and self.per_minute:
            self.put([*self.g(self.rng.choice("01")), self.axis(name, self.at[name] or 0.0)])

    def increments(self) -> None:
        if not self.absolute or not self.per_minute:
            return
        self.absolute = False
        words = ["G91", *self.g("1")]
        self.put(words + [self.axis(name, (self.at[name] or 0.0) + 7.5) for name in self.rng.sample("XYZ", 2)])
        for _ in range(self.rng.randint(0, 2)):
            self.put([self.axis(self.rng.choice("XYZ"), self.random_target())])
        self.absolute = True
        self.put(["G90"])

    def arc(self) -> None:
        if not self.per_minute:
            return
        first, second, normal = PLANES[self.plane]
        if self.turned and self.plane != 17:
            return
        u, v = self.at[first], self.at[second]
        if self.absolute and (u is None or v is None):
            return
        u, v = u or 0.0, v or 0.0
        radius, begin = self.rng.choice([3.0, 12.5, 40.0, 150.0]), self.rng.uniform(0, 2 * math.pi)
        sense = self.rng.choice([1, -1])
        centre = (u - radius * math.cos(begin), v - radius * math.sin(begin))
        words = self.g("3" if sense > 0 else "2")
        form = self.rng.choice(["centre"] * 5 + ["radius"] * 3 + ["full"])
        turn = 2 * math.pi if form == "full" else self.rng.choice([0.3, 1.2, math.pi / 2, 2.5, math.pi, 4.0, 5.8])
        if form == "radius" and abs(turn - math.pi) < 0.3:
            turn = 2.0
        end = [c + radius * f(begin + sense * turn) for c, f in zip(centre, (math.cos, math.sin), strict=True)]
        if form != "full":
            words += [self.axis(first, end[0]), self.axis(second, end[1])]
        if self.rng.random() < 0.25:
            words.append(self.axis(normal, (self.at[normal] or 0.0) + self.rng.uniform(-20, 20)))
        if form == "radius":
            words.append("R" + self.style.value((radius if turn < math.pi else -radius) / self.unit, self.decimals))
        else:
            base = (0.0, 0.0) if self.centres else (u, v)
            words += [
                CENTRES[name] + self.style.value((c - b) / self.unit, self.decimals)
                for name, c, b in zip((first, second), centre, base, strict=True)
            ]
            if self.rng.random() < 0.1:
                words.append(f"P{self.rng.randint(1, 3)}")
        if self.centres and not self.absolute and form != "radius":
            self.at[first] = self.at[second] = None
            self.motion = None
            return
        self.put(words)

    def polar(self) -> None:
        if not self.absolute or self.plane != 17 or not self.per_minute or self.turned or self.rng.random() < 0.7:
            return
        radius, angle = self.rng.choice([5.0, 20.0, 64.5]), self.rng.choice([0, 30, 45, 90, 135.5, -60])
        self.put([*self.g(self.rng.choice("01")), f"@{self.style.value(radius / self.unit)}", f"^{angle}"])
        self.at["X"], self.at["Y"] = (radius * math.cos(math.radians(angle)), radius * math.sin(math.radians(angle)))
        if self.rng.random() < 0.5:
            self.put([f"^{angle + 15}"])
        self.at["X"] = self.at["Y"] = None

    def machine_move(self) -> None:
        if not self.absolute:
            return
        name = self.rng.choice("ZZXY")
        self.motion = self.rng.choice("01" if self.per_minute else "0")
        self.put(["G53", f"G{self.motion}", f"{name}{self.style.value(self.rng.uniform(100, 400) / self.unit, 2)}"])
        self.at[name] = None
        if self.rng.random() < 0.6:
            self.place()

    def reference(self) -> None:
        code = self.rng.choice(["28", "30"])
        if self.absolute:
            words = [f"{name}{self.style.value(self.rng.uniform(0, 30), 1)}" for name in self.rng.sample("XYZ", 2)]
        else:
            words = ["Z0"]
        self.put([f"G{code}", *words])
        self.at, self.motion = dict.fromkeys("XYZ"), None
        if self.rng.random() < 0.7:
            self.place()

    def inverse_time(self) -> None:
        if not self.per_minute:
            return
        self.put(["G93"])
        self.per_minute = False
        for _ in range(self.rng.randint(1, 3)):
            self.motion = "1"
            self.put(
                ["G1", self.axis(self.rng.choice("XYZ"), self.random_target()), f"F{self.rng.choice([0.5, 2, 10])}"]
            )
        self.per_minute = True
        self.put(["G94", "F" + self.style.value(500 / self.unit, 2)])

    def drill(self) -> None:
        """A canned cycle with a few holes."""
        if not self.per_minute or (self.turned and self.plane != 17):
            return
        first, second, normal = PLANES[self.plane]
        if not self.absolute:
            self.absolute = True
            self.put(["G90"])
        self.put([*self.g("0"), self.axis(first, 10.0), self.axis(second, -5.0), self.axis(normal, 60.0)])
        code = self.rng.choice(["81", "81", "82", "83", "73", "85", "89"])
        depth, back = self.rng.uniform(-20, 10), self.rng.uniform(20, 40)
        words = [self.rng.choice(["G98", "G99"]), f"G{code}", self.axis(first, self.random_target())]
        words += [self.axis(second, self.random_target())] if self.rng.random() < 0.7 else []
        words += [normal + self.style.value(depth / self.unit), "R" + self.style.value(back / self.unit)]
        words += ["P0.5"] if code in {"82", "89"} else []
        words += ["Q" + self.style.value(7 / self.unit)] if code in {"83", "73"} else []
        self.put(words)
        for _ in range(self.rng.randint(0, 3)):
            words = [self.axis(name, self.random_target()) for name in self.rng.choice([(first,), (first, second)])]
            if self.rng.random() < 0.2:
                words.append(normal + self.style.value((depth - 3) / self.unit))
            if self.rng.random() < 0.2:
                words += ["L1"]
            self.put(words)
        if self.rng.random() < 0.1:
            self.put(["G91", f"{first}{self.style.value(3.5 / self.unit)}", f"L{self.rng.randint(1, 3)}"])
            self.put(["G80", "G90"])
            self.at[first] = None
        else:
            self.put(["G80"])
        self.at[normal], self.motion = None, None
        if self.rng.random() < 0.7:
            self.place()

    def contour(self) -> None:
        """A closed contour with the tool beside it, 4 or 5 mm off."""
        if not self.per_minute or self.plane != 17:
            return
        rng, half = self.rng, self.rng.choice([30.0, 55.5])
        x, y = rng.uniform(-60, 60), rng.uniform(-60, 60)
        self.absolute = True
        self.put(["G90", "G0", self.axis("X", x - half - 40), self.axis("Y", y - 40)])
        self.motion = "0"
        side = rng.choice(["G41", "G42"])
        self.put([side, f"D{rng.choice([1, 2])}", *self.g("1"), self.axis("X", x - half), self.axis("Y", y)])
        clockwise = (side == "G41") != (rng.random() < 0.3)
        corners = [(-half, half), (half, half), (half, -half), (-half, -half)]
        if not clockwise:
            corners = [(cx, -cy) for cx, cy in corners]
        for cx, cy in corners:
            if rng.random() < 0.25:
                self.put(
                    [*self.g("1"), self.axis("X", x + cx), self.axis("Y", y + cy), self.axis("Z", self.random_target())]
                )
                continue
            words = [self.axis(name, c + d) for name, c, d in (("X", x, cx), ("Y", y, cy)) if self.at[name] != c + d]
            self.put([*self.g("1"), *words])
        self.put([*self.g("1"), self.axis("X", x - half), self.axis("Y", y)])
        self.put(["G40", *self.g(rng.choice("01")), self.axis("X", x - half - 40), self.axis("Y", y - 40)])

    # --- modes and frames

    def modes(self) -> None:
        self.put([self.rng.choice(["G61", "G64", "G64 P0.01", "G61.1", "G40", "G97 S800", "M48", "M49"])])

    def turn_plane(self) -> None:
        self.plane = self.rng.choice([17, 18, 19])
        self.put([f"G{self.plane}"])

    def units(self) -> None:
        self.unit = MM_PER_INCH if self.unit == 1.0 else 1.0
        self.put(["G21" if self.unit == 1.0 else "G20"])

    def distance(self) -> None:
        if self.rng.random() < 0.2:
            self.centres = not self.centres
            self.put(["G90.1" if self.centres else "G91.1"])
        else:
            self.absolute = not self.absolute
            self.put(["G90" if self.absolute else "G91"])

    def _moved_frame(self) -> None:
        self.at = dict.fromkeys("XYZ")
        if self.rng.random() < 0.6:
            self.place()

    def frame(self) -> None:
        words = [f"G{self.rng.choice(OFFSETS)}"]
        if self.rng.random() < 0.3 and self.absolute and self.per_minute:
            self.motion, self.at = self.rng.choice("01"), dict.fromkeys("XYZ")
            words += [f"G{self.motion}", *(self.axis(name, self.random_target()) for name in self.rng.sample("XYZ", 2))]
        self.put(words)
        self.turned = True  # it may be one that a G10 has turned
        self._moved_frame()

    def preset(self) -> None:
        code = self.rng.choice(["92", "92", "92", "92.1", "92.2", "92.3"])
        words = [f"G{code}"]
        if code == "92":
            words += [f"{name}{self.style.value(self.rng.uniform(-30, 30), 2)}" for name in self.rng.sample("XYZ", 2)]
        self.put(words)
        self._moved_frame()

    def shift(self) -> None:
        self.put(["G52", f"{self.rng.choice('XY')}{self.style.value(self.rng.uniform(-30, 30), 2)}"])
        self._moved_frame()

    def seldom(self) -> None:
        """Splines, threads, probing, tapping and feed per revolution, in a few programs."""
        if not self.absolute or not self.per_minute or self.plane != 17 or self.turned or self.rng.random() < 0.7:
            return
        self.place()
        x, y, z = (self.style.value(self.rng.uniform(-30, 30) / self.unit, 2) for _ in "XYZ")
        low, high, above = (self.style.value(length / self.unit, 3) for length in (-20.5, 30.25, 60.0))
        hole = [f"X{x}", f"Y{y}", f"Z{low}", f"R{high}"]
        forms = [
            [["G5", f"X{x}", f"Y{y}", "I1", "J2", "P-1", "Q2"]],
            [["G5.1", f"X{x}", f"Y{y}", "I1", "J2"]],
            [["S500", "M3"], ["G33", f"Z{low}", "K1.5"]],
            [["G38.3", f"Z{low}", "F100"]],
            [["S500", "M4"], ["G0", f"Z{above}"], ["G98", "G74", *hole, "F500"], ["G80"]],
            [["S500", "M3"], ["G0", f"Z{above}"], ["G98", "G84", *hole, "F500"], ["G80"]],
            [["S500", "M3"], ["G0", f"Z{above}"], ["G98", "G86", *hole, "P0.5", "F500"], ["G80"]],
            [["S500", "M3"], ["G95", "F0.2"], ["G1", f"X{x}", f"Z{z}"], ["G94", "F300"]],
        ]
        for words in self.rng.choice(forms):
            self.put(words)
        self.motion, self.at = None, dict.fromkeys("XYZ")
        self.place()

    def set_data(self) -> None:
        kind, number = self.rng.choice(["2", "2", "20"]), self.rng.randint(0, 9)
        words = ["G10", f"L{kind}", f"P{number}"]
        words += [f"{name}{self.style.value(self.rng.uniform(-40, 40), 3)}" for name in self.rng.sample("XYZ", 2)]
        if kind == "2" and self.rng.random() < 0.4:
            words.append(f"R{self.rng.choice([0, 30, 45.5, -90])}")
        self.turned = True
        self.put(words)
        self._moved_frame()

    def tool(self) -> None:
        match self.rng.randrange(5):
            case 0:
                self.put([f"T{self.rng.choice(TOOLS)}", "M6"])
            case 1:
                self.put(["G43", f"H{self.rng.choice(TOOLS)}"])
            case 2:
                self.put(["G49"])
            case 3:
                self.put(["G43.1", f"Z{self.style.value(self.rng.uniform(5, 60), 2)}"])
            case _:
                self.put([f"T{self.rng.choice(TOOLS)}"])
        self._moved_frame()

    def dwell(self) -> None:
        self.put(["G4", self.rng.choice(["P0.5", "P1", "P.1"])])

    def switch(self) -> None:
        if not self.per_minute:
            return
        word = self.rng.choice(["M3 S500", "M4 S900", "M5", "M7", "M8", "M9", "M0", "M1", "M62 P1", "M64 P2", "M65 P2"])
        words = word.split()
        if self.rng.random() < 0.5:
            words += [*self.g("1"), self.axis(self.rng.choice("XYZ"), self.random_target())]
        self.put(words)

    def note(self) -> None:
        texts = ["(MSG, clamp the part)", "(DEBUG, here)", "(plain)", "; X1 Y1 Z1", "(PRINT, here)", "(AXIS, stop)"]
        self.out.append(self.rng.choice(texts) + self.style.end)

    def blank(self) -> None:
        self.out.append(self.rng.choice(["", "   ", "\t"]) + self.style.end)

    def skip(self) -> None:
        self.put([self.rng.choice(["M8", "(later)", "M1", "G4 P1"])], skip=True)

    # --- variables and flow

    def assign(self) -> None:
        name = self.rng.choice(["#1", "#2", "#31", "#<depth>", "#<_safe>"])
        value = round(self.rng.uniform(-20, 20), self.rng.randint(0, 3))
        form = self.rng.randrange(4)
        if form == 0 and self.known:
            other, part = self.rng.choice(list(self.known.items()))
            self.out.append(f"{name}=[{other} + {value}]{self.style.end}")
            value += part
        elif form == 1 and name in self.known and self.absolute and not self.simple:
            # the word still has the value that the variable had before this block
            axis = self.rng.choice("XYZ")
            self.put([f"{name}={value}", *self.g("0"), f"{axis}{name}"], keep=True)
            self.at[axis] = self.known[name] * self.unit
        else:
            self.out.append(f"{name} = {value}{self.style.end}")
        if self.simple:
            self.known.pop(name, None)
        else:
            self.known[name] = value

    def formula(self) -> None:
        if not self.per_minute:
            return
        name = self.rng.choice("XYZ")
        text, value = self.rng.choice([
            ("[10*SIN[30]]", 5.0), ("[2**3]", 8.0), ("[SQRT[2]*5]", 5 * math.sqrt(2)), ("[-[7/2]]", -3.5),
            ("[7 MOD 4]", 3.0), ("[ABS[-4.5]]", 4.5), ("[FIX[-2.5]]", -3.0), ("[FUP[2.1]]", 3.0), ("[ROUND[2.5]]", 3.0),
            ("[1 + 2 * 3]", 7.0), ("[10 - 4 - 3]", 3.0), ("[ATAN[1]/[1]]", 45.0), ("[5 GT 3]", 1.0), ("[2 ** 3 * 2]", 16.0),
            ("[12 / 4 / 3]", 1.0), ("[1 AND 0]", 0.0), ("[EXP[0] + LN[1]]", 1.0), ("COS[60]", 0.5), ("[8 / 2 * 4]", 16.0),
            ("[-2 ** 2]", 4.0), ("[3 - -2]", 5.0), ("ACOS[0]", 90.0), ("[2 + 3 MOD 2]", 3.0), ("[3 XOR 0]", 1.0),
        ])  # fmt: skip
        self.put([*self.g(self.rng.choice("01")), name + text], keep=True)
        here = self.at[name]
        self.at[name] = value * self.unit if self.absolute else None if here is None else here + value * self.unit

    def _body(self, lines: int) -> None:
        """A few plain statements with an unknown start; the state after them is not known either."""
        before, self.simple = self.simple, True
        absolute, per_minute = self.absolute, self.per_minute
        self.at, self.motion = dict.fromkeys("XYZ"), None
        for name in [name for name in self.known if self.rng.random() < 2]:
            del self.known[name]
        for _ in range(lines):
            self.rng.choice(self._statements())()
        self.at, self.motion = dict.fromkeys("XYZ"), None
        self.known.clear()
        self.absolute, self.per_minute, self.simple = absolute, per_minute, before

    def _label(self) -> str:
        self.labels += 1
        return self.rng.choice([f"o{self.labels}", f"o<part{self.labels}>", f"O{self.labels}"])

    def _flow(self, text: str) -> None:
        self.out.append(text + self.style.end)

    def branch(self) -> None:
        label, (condition) = self._label(), self.rng.choice(["3 gt 2", "1 EQ 0", "#9 ne 4", "2 le 2"])
        self.out.append("#9 = 4" + self.style.end)
        self._flow(f"{label} if [{condition}]")
        self._body(self.rng.randint(1, 3))
        if self.rng.random() < 0.3:
            self._flow(f"{label} elseif [#9 eq 4]")
            self._body(1)
        if self.rng.random() < 0.6:
            self._flow(f"{label} else")
            self._body(self.rng.randint(1, 2))
        self._flow(f"{label} endif")
        self._after()

    def loop(self) -> None:
        label, count, counter = self._label(), self.rng.randint(0, 3), f"#{self.labels}"
        kind = self.rng.choice(["while", "repeat", "do"])
        self._flow(f"{counter} = 0")
        self._flow(
            {"while": f"{label} while [{counter} lt {count}]", "repeat": f"{label} repeat [{count}]"}.get(
                kind, f"{label} do"
            )
        )
        if self.rng.random() < 0.6:
            name, step = self.rng.choice("XYZ"), self.rng.choice(["5", "0.25", "-3"])
            self.at, self.motion = dict.fromkeys("XYZ"), None
            self.put(["G1", f"{name}[{counter} * {step} + 1]"], keep=True)
        self._body(self.rng.randint(1, 3))
        self._flow(f"{counter} = [{counter} + 1]")
        if self.rng.random() < 0.2:
            inner = self._label()
            word = "break" if kind == "do" else self.rng.choice(["break", "continue"])  # LinuxCNC loses count there
            self._flow(f"{inner} if [{counter} ge 2]")
            self._flow(f"{label} {word}" if kind != "repeat" else f"{counter} = {counter}")
            self._flow(f"{inner} endif")
        self._flow(
            {"while": f"{label} endwhile", "repeat": f"{label} endrepeat"}.get(
                kind, f"{label} while [{counter} lt {count}]"
            )
        )
        self._after()

    def call(self) -> None:
        label = self._label()
        self._flow(f"{label} sub")
        if self.rng.random() < 0.7:
            self.at, self.motion = dict.fromkeys("XYZ"), None
            self.put(["G1", "X#1", self.rng.choice(["Y[#2 * 2]", "Z#2", "Y[#1 + #2]"])], keep=True)
        self._body(self.rng.randint(1, 3))
        returns = self.rng.random() < 0.3
        self._flow(f"{label} endsub" + (" [#1 + 1]" if returns else ""))
        for _ in range(self.rng.randint(1, 2)):
            self._flow(f"{label} call [{self.rng.randint(-30, 30)}] [{self.rng.randint(-9, 9)}.5]")
        self._after()
        if returns and self.absolute:
            self.motion = None
            self.put([*self.g("0"), "X#<_value>"], keep=True)
            self.at["X"] = None

    def _after(self) -> None:
        self.at, self.motion = dict.fromkeys("XYZ"), None
        if self.rng.random() < 0.7:
            self.place()


def program(seed: int, *, contours: bool = False, plain: bool = False) -> str:
    """A random program; with `contours`, some of it with cutter compensation; `plain`, mostly moves."""
    return Program(seed, contours=contours, plain=plain).text()
