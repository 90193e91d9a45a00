"""`correct` held against `verify`, against the text, and against a second reckoner, in three dialects on all machines.

A program is drawn as moves and written in one of three dialects. Of straight moves, also in loops, with variables, in
frames, in tilted planes and of the tool point with rotary axes, the corrected text is reckoned anew: words, variables
and planes by `reckoner`, kinematics by `tests/virtual_machine`, errors by a polynomial evaluated there. Of all programs
`verify` judges the two texts.
"""

from __future__ import annotations

import io
import json
import random
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kinematics.error_model.model import ErrorModel, decode_model, no_errors
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.correct.result import CorrectionResult
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.text.source import ENCODING, HEAD_SIZE, Source
from postproc.verification.verify import read_motions, verify
from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.ncomp import reason_of
from tests.fuzz.reckoner import Reckoner, about

TESTS = Path(__file__).parents[1]
MACHINES_FOLDER = TESTS.parent / "machines"
MACHINES = ("gantry", "cframe", "bzt_pfu", "dmu50", "trunnion_bc", "trunnion_ac", "head_head", "head_table")
ENDINGS = {"iso": ".nc", "siemens": ".mpf", "heidenhain": ".h"}
LENGTH = 80.0
"""Length of the tool, mm."""
REACH = 40.0
"""Largest distance of programmed positions from the middle of X, Y and Z, mm."""
TURN = 25.0
"""Largest rotation of rotary axes from the middle of their travel, degrees."""
ROUNDING_UM = 0.35
"""Error of the tool point by the rounding of axis words, 0.1 um and 0.1 mdeg, um."""
LARGE = (1e3,)
"""Tolerance at which nothing is split; with backlash nothing would be a reversal either."""
CLAIM_UM = 0.05
"""Largest difference between the errors that a run predicts and those that `verify` finds, um."""
ACCEPTED = frozenset(("stale", "future", "temperature", "outside", "insignificant"))
"""What random errors are not expected to keep to; worse than before no move may be."""
KINDS = ("constant", "smooth", "located", "play", "steps", "cyclic")
RECKONED = ("constant", "smooth", "located")
_COORDINATE = re.compile(
    r"(?<![A-Z])(I?[XYZABC]|[IJKR]|CR|PR|I?PA)(\s*=?\s*(?:AC\(|IC\()?)"
    r"(\[[^\]]*\]|[-+]?(#\d+|QL?\d+|R\d[^\s)]*|\d+[.,]?\d*|[.,]\d+))"
)
_OWN = re.compile(r"NCOMP|FN 1: QL4")


class Move(NamedTuple):
    """One block: `G0`, `G1`, or another text in which positions of the axes are inserted."""

    rapid: bool
    words: dict[str, float]


# ---- programs


def draw(seed: int) -> Case:
    """A program in one of three dialects, and the errors of one of the machines."""
    rng = random.Random(seed)
    machine, dialect = rng.choice(MACHINES), rng.choice(list(ENDINGS))
    chain = _chain(machine)
    tcp = bool(_rotary(chain)) and rng.random() < 0.35
    writer = Writer(dialect, rng, chain)
    text = writer.program(tcp)
    kind = rng.choice(KINDS)
    plan = {
        "kind": kind,
        "tcp": tcp,
        "plain": writer.plain,
        "dialect": dialect,
        "unroll": writer.loops and rng.random() < 0.7,
        "tolerance": rng.choice((1.0, 1.0, 5.0, *LARGE[kind == "play" :])),
    }
    return Case(text, f"part{ENDINGS[dialect]}", machine, json.dumps(_effects(kind, chain, rng)), (json.dumps(plan),))


class Writer:
    """Writes moves and other blocks of programs in one dialect."""

    def __init__(self, dialect: str, rng: random.Random, chain: Any) -> None:
        self.dialect, self.rng, self.chain = dialect, rng, chain
        self.rotary = _rotary(chain)
        self.plain = True
        """The reckoner knows every block."""
        self.loops = False
        """Blocks run more than once."""
        self.lines: list[str] = []
        self.at: dict[str, float] = {}
        self.label = 0

    def program(self, tcp: bool) -> str:
        """The text."""
        rng = self.rng
        heads = {
            "iso": ["G21 G90 G17 G94 G54", "T1 M6", "G43 H1"],
            "siemens": ["G17 G90 G71 G94 G54", "T1 M6 D1"],
            "heidenhain": ["BEGIN PGM PART MM", "TOOL CALL 1 Z S1000"],
        }
        self.lines += heads[self.dialect]
        self.move(True, {axis: self.place(axis) for axis in [*"XYZ", *self.rotary]})
        if tcp:
            self.lines.append({"iso": "G43.4 H1", "siemens": "TRAORI", "heidenhain": "M128"}[self.dialect])
            self.move(True, {axis: self.place(axis) for axis in [*"XYZ", *self.rotary]})
        known = (
            self.loop,
            self.shift,
            self.turn,
            self.formulas,
            *((self.tilted,) * 4 if len(self.rotary) == 2 else ()),
        )
        fancy = (
            ()
            if tcp or rng.random() < 0.15
            else known
            if rng.random() < 0.5
            else (self.arc, self.loop, self.increments, self.shift, self.turn, self.hole, self.call, *known)
        )
        for _ in range(rng.randint(2, 9)):
            rng.choice((self.line, self.line, self.rapid, *fancy))()
        self.lines += {"iso": ["M30"], "siemens": ["M30"], "heidenhain": ["M30", "END PGM PART MM"]}[self.dialect]
        self.lines += self.behind()
        return "\n".join([*self.lines, ""])

    def place(self, axis: str) -> float:
        if axis in self.rotary:
            low, high = self.chain.axis(axis).travel
            middle = min(max(0.0, low + TURN + 1.0), high - TURN - 1.0)
            return round(middle + self.rng.uniform(-TURN, TURN), 3)
        return round(self.rng.uniform(-REACH, REACH), 3)

    def words(self, values: dict[str, float]) -> str:
        out = []
        for axis, value in values.items():
            text = f"{value + 0.0:.3f}"
            if self.dialect == "heidenhain":
                out.append(f"{axis}{'' if value < 0 else '+'}{text}")
            else:
                out.append(f"{axis}{'=' if self.dialect == 'siemens' and axis == 'Y' else ''}{text}")
        return " ".join(out)

    def move(self, rapid: bool, values: dict[str, float], more: str = "") -> None:
        self.at |= {a: v for a, v in values.items() if a in "XYZ" or a in self.rotary}
        if self.dialect == "heidenhain":
            self.lines.append(f"L {self.words(values)} {'FMAX' if rapid else 'F500'}{more}")
        else:
            self.lines.append(f"{'G0' if rapid else 'G1'} {self.words(values)}{'' if rapid else ' F500'}{more}")

    def some(self) -> dict[str, float]:
        axes = self.rng.sample("XYZ", self.rng.randint(1, 3)) + [a for a in self.rotary if self.rng.random() < 0.4]
        return {axis: self.place(axis) for axis in axes}

    def line(self) -> None:
        self.move(False, self.some())

    def rapid(self) -> None:
        self.move(True, self.some())

    def everywhere(self) -> None:
        self.move(True, {axis: self.place(axis) for axis in "XYZ"})

    # ---- blocks that only `verify` evaluates

    def arc(self) -> None:
        self.plain = False
        self.move(True, {axis: self.place(axis) for axis in "XYZ"})
        radius, first = self.rng.uniform(3, 20), self.rng.uniform(0, 6.28)
        sense, turn = self.rng.choice((1, -1)), self.rng.uniform(0.3, 6.0)
        x, y = self.at["X"], self.at["Y"]
        cx, cy = round(x - radius * np.cos(first), 3), round(y - radius * np.sin(first), 3)
        ex, ey = cx + radius * np.cos(first + sense * turn), cy + radius * np.sin(first + sense * turn)
        end = {"X": round(float(ex), 3), "Y": round(float(ey), 3)}
        self.at |= end
        if self.dialect == "heidenhain":
            self.lines += [
                f"CC {self.words({'X': cx, 'Y': cy})}",
                f"C {self.words(end)} DR{'+' if sense > 0 else '-'} F500",
            ]
            return
        centre = (
            f"I{cx - x:.3f} J{cy - y:.3f}" if self.dialect == "iso" or sense > 0 else f"I=AC({cx:.3f}) J=AC({cy:.3f})"
        )
        self.lines.append(f"G{3 if sense > 0 else 2} {self.words(end)} {centre} F500")

    def increments(self) -> None:
        self.plain = False
        step = {axis: round(self.rng.uniform(-5, 5), 3) for axis in "XYZ"}
        if self.dialect == "heidenhain":
            self.lines.append("L " + " ".join(f"I{axis}{value:+.3f}" for axis, value in step.items()) + " F500")
        else:
            self.lines += ["G91", f"G1 {self.words(step)} F500", "G90"]
        self.everywhere()

    def loop(self) -> None:
        self.loops = True
        place = {axis: self.place(axis) for axis in "XYZ"}
        passes, number = self.rng.randint(2, 4), self.number()
        self.move(True, place)
        body_at = len(self.lines)
        for _ in range(self.rng.randint(1, 3)):
            self.move(False, {axis: self.place(axis) for axis in self.rng.sample("XYZ", 2)})
        self.move(False, place)
        body = self.lines[body_at:]
        del self.lines[body_at:]
        self.repeat(body, number, passes)

    def repeat(self, body: list[str], number: int, passes: int) -> None:
        """Lines that run several times."""
        if self.dialect == "iso":
            self.lines += ["#100=0", f"WHILE[#100 LT {passes}]DO1", *body, "#100=#100+1", "END1"]
        elif self.dialect == "siemens":
            self.lines += [f"FOR R{number}=1 TO {passes}", *body, "ENDFOR"]
        else:
            self.lines += [f"LBL {number}", *body, f"CALL LBL {number} REP{passes - 1}"]

    def formulas(self) -> None:
        """Coordinates by variables, which grow in a loop."""
        self.loops = True
        self.everywhere()
        number, passes = self.number(), self.rng.randint(2, 4)
        name = {"iso": "#{}", "siemens": "R{}", "heidenhain": "Q{}"}[self.dialect].format
        one, two = name(50 + 2 * number), name(51 + 2 * number)
        equals = " = " if self.dialect == "heidenhain" else "="
        first, step = self.place("X") / 2, round(self.rng.uniform(-4, 4), 3)
        self.lines += [
            f"{one}{equals}{first:.4f}",
            f"{two}{equals}{one} * {step}".replace(" ", " " if self.dialect == "heidenhain" else ""),
        ]
        body = [
            {
                "iso": f"G1 X{one} Y[{two}-{one}*0.5] F500",
                "siemens": f"G1 X={one} Y={two}-{one}*0.5 F500",
                "heidenhain": f"L X+{one} Y-{two} F500",
            }[self.dialect],
            {"iso": f"G1 Z[{two}]", "siemens": f"G1 Z={two}", "heidenhain": f"L Z+{two}"}[self.dialect],
            f"{one}{equals}{one}+{abs(step)}".replace("+", " + " if self.dialect == "heidenhain" else "+"),
        ]
        self.repeat(body, number, passes)
        self.everywhere()

    def tilted(self) -> None:
        """A plane across the tool as some position of the rotary axes stands it up, turned about it by any angle."""
        stands = {axis: self.place(axis) for axis in self.rotary}
        named = tuple(axis for axis in self.chain.names if axis in self.rotary)
        upright = _tool_directions(self.chain, [stands[axis] for axis in named])
        plane = upright @ about("Z", self.rng.choice((0.0, 90.0, self.rng.uniform(-180, 180))))
        by = {axis: round(self.rng.uniform(-9, 9), 3) for axis in "XYZ"}
        tip = " ".join(f"{axis}{value:.3f}" for axis, value in by.items())
        if self.dialect == "iso":
            self.move(True, stands)
            first, second, third = _euler(plane)
            self.lines += [f"G68.2 {tip} I{first:.8f} J{second:.8f} K{third:.8f}", "G53.1"]
        elif self.dialect == "siemens":
            a, b, c = _axis_by_axis(plane)
            lower = stands[_tilting(self.chain)] < 0
            self.lines += [
                f'CYCLE800(1,"TC",0,57,{",".join(f"{by[axis]:.3f}" for axis in "XYZ")},{a:.8f},{b:.8f},{c:.8f},'
                f"0,0,0,{-1 if lower else 1},100,1)",
                "; STANDS " + " ".join(f"{axis}{value}" for axis, value in stands.items()),
            ]
        else:
            a, b, c = _spatial(plane)
            self.datum(by)
            self.lines.append(f"PLANE SPATIAL SPA{a:+.8f} SPB{b:+.8f} SPC{c:+.8f} STAY")
            self.move(True, stands)
        self.everywhere()
        for _ in range(self.rng.randint(1, 4)):
            rapid = self.rng.random() < 0.3
            self.move(rapid, {axis: self.place(axis) for axis in self.rng.sample("XYZ", self.rng.randint(1, 3))})
        self.lines.append({"iso": "G69", "siemens": "CYCLE800()", "heidenhain": "PLANE RESET STAY"}[self.dialect])
        if self.dialect == "heidenhain":
            self.datum(dict.fromkeys(by, 0.0))
        self.everywhere()

    def shift(self) -> None:
        by = {axis: round(self.rng.uniform(-9, 9), 3) for axis in "XYZ"}
        self.frame(by, None)

    def turn(self) -> None:
        self.frame(
            {axis: round(self.rng.uniform(-9, 9), 3) for axis in "XY"}, self.rng.choice((90, 30, -45, 180, 12.5))
        )

    def frame(self, by: dict[str, float], angle: float | None) -> None:
        shifted = " ".join(f"{a}{v:.3f}" for a, v in by.items())
        if self.dialect == "iso":
            self.lines += [f"G52 {shifted}"] if angle is None else [f"G68 {shifted} R{angle}"]
        elif self.dialect == "siemens":
            self.lines += [f"TRANS {shifted}", *([] if angle is None else [f"AROT Z{angle}"])]
        else:
            self.datum(by)
            if angle is not None:
                self.lines += ["CYCL DEF 10.0 ROTATION", f"CYCL DEF 10.1 ROT{angle:+}"]
        for _ in range(self.rng.randint(1, 4)):
            self.move(self.rng.random() < 0.3, {axis: self.place(axis) for axis in "XYZ"})
        if self.dialect == "iso":
            self.lines += ["G52 X0. Y0. Z0."] if angle is None else ["G69"]
        elif self.dialect == "siemens":
            self.lines.append("TRANS")
        else:
            if angle is not None:
                self.lines += ["CYCL DEF 10.0 ROTATION", "CYCL DEF 10.1 ROT+0"]
            self.datum(dict.fromkeys(by, 0.0))
        self.everywhere()

    def datum(self, by: dict[str, float]) -> None:
        self.lines.append("CYCL DEF 7.0 DATUM SHIFT")
        self.lines += [f"CYCL DEF 7.{i} {axis}{value:+.3f}" for i, (axis, value) in enumerate(by.items(), 1)]

    def hole(self) -> None:
        self.plain = False
        self.move(True, {"X": self.place("X"), "Y": self.place("Y"), "Z": REACH})
        at = {axis: self.place(axis) for axis in "XY"}
        if self.dialect == "iso":
            self.lines += [f"G98 G81 {self.words(at)} Z-5. R5. F100", "G80"]
        elif self.dialect == "siemens":
            self.lines += [f"MCALL CYCLE81({REACH},0,5,-5)", self.words(at), "MCALL"]
        else:
            cycle = "CYCL DEF 200 DRILLING ~\n  Q200=5 ;A ~\n  Q201=-5 ;B ~\n  Q203=+0 ;C ~\n  Q204=40 ;D"
            self.lines += [*cycle.split("\n"), f"L {self.words(at)} FMAX M99"]
        self.everywhere()

    def call(self) -> None:
        self.plain = False
        self.label = self.label or self.number()
        self.lines.append({"iso": "M98 P700", "siemens": "UPR", "heidenhain": f"CALL LBL {self.label}"}[self.dialect])
        self.everywhere()

    def behind(self) -> list[str]:
        """The subprogram."""
        if not self.label:
            return []
        start, self.lines = self.lines, []
        for _ in range(2):
            self.everywhere()
        body, self.lines = self.lines, start
        if self.dialect == "iso":
            return ["O700", *body, "M99"]
        if self.dialect == "siemens":
            return ["%_N_UPR_SPF", *body, "M17"]
        end = [self.lines.pop()]
        return [f"LBL {self.label}", *body, "LBL 0", *end]

    def number(self) -> int:
        self.count = getattr(self, "count", 0) + 1
        return self.count


def _effects(kind: str, chain: Any, rng: random.Random) -> list[dict[str, Any]]:
    """Effects of a calibration, as its file has them; of polynomials, which the tests work out a second time."""
    found = []
    for axis in chain.axes:
        low, high = axis.travel
        if axis.rotary and high - low >= 360.0:  # the whole turn, once
            low = max(low, -180.0)
            high = low + 360.0
        if kind in RECKONED:
            degree = 0 if kind == "constant" else 2
            for component in "XYZ" if kind == "constant" else "XYZABC":
                values = [rng.uniform(-25, 25) for _ in range(degree + 1)]
                basis = {"kind": "polynomial", "interval": [low, high], "degree": degree}
                found.append({"kind": "error-motion", "component": component, "axis": axis.name, "basis": basis,
                              "parameters": values, "units": {"parameters": "um" if component in "XYZ" else "urad"}, "u": [], "note": ""})  # fmt: skip
        elif axis.rotary:
            continue
        elif kind == "play":
            found.append({"kind": "backlash", "axis": axis.name, "width": rng.uniform(3, 20), "units": {"width": "um"}})
        elif kind == "steps":
            found.append({"kind": "quantised-compensation", "axis": axis.name, "step": rng.uniform(0.5, 5.0), "pitch": rng.uniform(7, 60),
                          "offset": 1.0, "units": {"step": "um", "pitch": "mm", "offset": "mm"}})  # fmt: skip
        else:
            sine, cosine = [rng.uniform(-6, 6)], [rng.uniform(-6, 6)]
            found.append({"kind": "cyclic", "component": axis.name, "axis": axis.name, "period": rng.uniform(8, 60), "sine": sine,
                          "cosine": cosine, "units": {"period": "mm", "sine": "um", "cosine": "um"}})  # fmt: skip
    if kind == "located":
        for axis in chain.axes:
            if axis.rotary:
                for component in "XYZAB":
                    found.append({"kind": "location", "component": component, "axis": axis.name, "value": rng.uniform(-25, 25),
                                  "units": {"value": "um" if component in "XYZ" else "urad"}})  # fmt: skip
    return found


# ---- examination


def judge(case: Case) -> Outcome:
    """Correct, verify, read the text, reckon."""
    plan = json.loads(case.options[0])
    machine, dialect = _machine(case.machine), find_dialect(plan["dialect"], case.name, "")
    source, setup = _source(case.program, case.name), _setup(case.machine, plan["dialect"])
    model = _model(case.machine, case.calibration)
    try:
        none, _ = _run(Job(source, dialect, machine, no_errors(machine), setup))
        options = {"tolerance_um": plan["tolerance"], "accepted": ACCEPTED, "unroll": plan.get("unroll", False)}
        text, report = _run(Job(source, dialect, machine, model, setup, **options))
    except UserError as refusal:
        return Outcome(Verdict.REFUSED, reason_of(str(refusal).partition("': ")[2])[:50])
    if none != case.program:
        return Outcome(Verdict.DIFFERS, "other bytes: without errors the program is not given back")
    corrected = _source(text, case.name)
    try:
        _run(Job(corrected, dialect, machine, model, setup))
        return Outcome(Verdict.DIFFERS, "twice: a corrected program is corrected again")
    except UserError as refusal:
        if "already corrected" not in str(refusal):
            return Outcome(Verdict.DIFFERS, f"twice: refused with other words: {refusal}")
    fault = "" if plan.get("unroll") else _text_fault(case.program, text)
    fault = fault or _verify_fault(case, plan, report, source, corrected, model)
    if not fault and plan["plain"] and plan["kind"] in RECKONED:
        fault = _reckoned_fault(case, text)
    return Outcome(Verdict.DIFFERS, fault) if fault else Outcome(Verdict.COMPARED)


def _text_fault(before: str, after: str) -> str:
    """Something else than coordinates has changed; empty for none."""
    own = [line for line in after.split("\n") if not _OWN.search(line)]
    lines = before.split("\n")
    if len(own) != len(lines):
        poles = [line for line in own if line.startswith("CC ")]
        own = [line for line in own if not line.startswith("CC ")]
        lines = [line for line in lines if not line.startswith("CC ")]
        if not poles or len(own) != len(lines):
            return f"blocks: {len(own)} instead of {len(lines)}"
    for old, new in zip(lines, own, strict=True):
        left, right = (_COORDINATE.sub("", re.sub(r"^CP ", "C ", line)).split() for line in (old, new))
        if left != right:
            return f"other words: {left} became {right}"
    return ""


def _verify_fault(
    case: Case, plan: dict[str, Any], report: CorrectionResult, source: Source, corrected: Source, model: ErrorModel
) -> str:
    machine, dialect = _machine(case.machine), find_dialect(plan["dialect"], case.name, "")
    setup = _setup(case.machine, plan["dialect"])
    try:
        texts = [merged(read_motions(each, dialect, machine, setup)) for each in (source, corrected)]
        verdict = verify(texts[0], texts[1], model, tolerance_um=plan["tolerance"])
    except UserError as refusal:
        return f"not verified: {refusal}"
    claims = (("before", report.before, verdict.before), ("after", report.after, verdict.after))
    for name, claim, found in claims:
        if abs(claim.largest - found.largest) > CLAIM_UM:
            return f"claim {name}: {claim.largest:.3f} um, and verify finds {found.largest:.3f}"
    if verdict.after.largest > verdict.before.largest + ROUNDING_UM:
        return f"worse: {verdict.before.largest:.3f} um before, {verdict.after.largest:.3f} after"
    kept = bool(report.not_split) or report.notes
    # the end of a CP by its angle may miss the circle's end by less than the tolerance
    most = ROUNDING_UM + (plan["tolerance"] if "CP " in corrected.head else 0.0)
    if plan["kind"] in RECKONED and verdict.after.largest > most and not kept:
        return f"not corrected: {verdict.after.largest:.3f} um after, without a note"
    if verdict.path_after.largest > plan["tolerance"] + ROUNDING_UM and not kept:
        return f"astray: {verdict.path_after.largest:.3f} um along feed moves, without a note"
    return ""


def _reckoned_fault(case: Case, text: str) -> str:
    """The tool point of every block of the program, reckoned from the corrected text, is not the nominal one."""
    chain, effects = _chain(case.machine), json.loads(case.calibration)
    dialect = json.loads(case.options[0])["dialect"]
    nominal, commanded = (
        Reckoner(dialect, lambda held, place, tip: _axes(chain, held, place, tip)).run(each)
        for each in (case.program, text)
    )
    if len(nominal) != len(commanded):
        return f"reckoned: {len(commanded)} moves instead of {len(nominal)}"
    if not nominal:
        return ""
    wanted = _points(chain, np.array(nominal), [])
    before, after = (_points(chain, np.array(q), effects) for q in (nominal, commanded))
    worst, was = (1e3 * np.linalg.norm(points - wanted, axis=1) for points in (after, before))
    row = int(np.argmax(np.nan_to_num(worst)))
    if worst[row] > ROUNDING_UM:
        return f"reckoned: {worst[row]:.3f} um off at move {row + 1}, {was[row]:.3f} before"
    return ""


def _axes(chain: Any, held: dict[str, float], place: Any, tip: bool) -> list[float]:
    """Axis positions, mm and rad, at a place `(3,)` of the program: of the tip on the workpiece, or of the axes."""
    offset = _offset(chain)
    said = [held.get(name, 0.0) * axis.per_file_unit for name, axis in zip(chain.names, chain.axes, strict=True)]
    q, wanted = np.array(said), place + [offset[axis] for axis in "XYZ"]
    linear = [chain.index(axis) for axis in "XYZ"]
    q[linear] = wanted + np.array([0.0, 0.0, LENGTH])
    if tip:  # the tool point is affine in X, Y and Z
        rows = np.repeat(q[None], 4, axis=0)
        rows[1:, linear] += np.eye(3)
        points = _points(chain, rows, [])
        q[linear] += np.linalg.solve((points[1:] - points[0]).T, wanted - points[0])
    return q.tolist()


def _tool_directions(chain: Any, stands: list[float]) -> Any:
    """Directions x, y, z of the tool in the workpiece, as columns (3, 3), by positions of the rotary axes, degrees."""
    q = np.zeros((4, len(chain.axes)))
    q[:, [axis.rotary for axis in chain.axes]] = np.deg2rad(stands)
    targets = np.vstack([np.zeros(3), np.eye(3)])
    points = np.vstack([_points(chain, q[i : i + 1], [], targets[i]) for i in range(4)])
    return (points[1:] - points[0]).T


def _tilting(chain: Any) -> str:
    """The rotary axis of least travel."""
    return str(min((axis for axis in chain.axes if axis.rotary), key=lambda axis: axis.travel[1] - axis.travel[0]).name)


def _euler(turn: Any) -> tuple[float, float, float]:
    """Angles, degrees, about z, the new x and the new z."""
    tilt = np.arccos(np.clip(turn[2, 2], -1.0, 1.0))
    if tilt < 1e-9:
        return float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))), 0.0, 0.0
    first, third = np.arctan2(turn[0, 2], -turn[1, 2]), np.arctan2(turn[2, 0], turn[2, 1])
    return float(np.degrees(first)), float(np.degrees(tilt)), float(np.degrees(third))


def _axis_by_axis(turn: Any) -> tuple[float, float, float]:
    """Angles, degrees, about x, the new y and the new z."""
    angles = -np.arctan2(turn[1, 2], turn[2, 2]), np.arcsin(turn[0, 2]), -np.arctan2(turn[0, 1], turn[0, 0])
    return tuple(float(np.degrees(angle)) for angle in angles)  # type: ignore[return-value]


def _spatial(turn: Any) -> tuple[float, float, float]:
    """Angles, degrees, about x, then y, then z of the workpiece."""
    angles = np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0]), np.arctan2(turn[1, 0], turn[0, 0])
    return tuple(float(np.degrees(angle)) for angle in angles)  # type: ignore[return-value]


def _points(
    chain: Any, q: Any, effects: list[dict[str, Any]], target: tuple[float, ...] | Any = (0.0, 0.0, -LENGTH)
) -> Any:
    from virtual_machine.calibrated import motion
    from virtual_machine.chain import tool_points

    errors = np.zeros((len(q), len(chain.axes), 6))
    for effect in effects:
        i = chain.index(effect["axis"])
        if effect["kind"] == "location":
            errors[:, i, "XYZABC".index(effect["component"])] += effect["value"]
            continue
        values = motion(chain.axes[i], effect["basis"], effect["parameters"], q[:, i] / chain.axes[i].per_file_unit)
        errors[:, i, "XYZABC".index(effect["component"])] += values
    errors[..., :3] *= 1e-3
    errors[..., 3:] *= 1e-6
    targets = np.broadcast_to(target, (len(q), 3))
    return tool_points(chain, q, errors, np.zeros((len(q), 6)), targets)


def _run(job: Job) -> tuple[str, CorrectionResult]:
    out = io.BytesIO()
    report = Pipeline(job).run(out, lambda _: None)
    return out.getvalue().decode(ENCODING), report


def _source(text: str, name: str) -> Source:
    data = text.encode(ENCODING)
    return Source(name, data[:HEAD_SIZE].decode(ENCODING), data)


def _rotary(chain: Any) -> list[str]:
    return [axis.name for axis in chain.axes if axis.rotary]


def _offset(chain: Any) -> dict[str, float]:
    """Work offset, mm: the middle of the travel."""
    middle = {axis: round(sum(chain.axis(axis).travel) / 2, 3) for axis in "XYZ"}
    return middle | {"Z": middle["Z"] - LENGTH}


@cache
def _chain(name: str) -> Any:
    sys.path.insert(0, str(TESTS))
    from virtual_machine.chain import load

    return load(name)


@cache
def _machine(name: str) -> Any:
    sys.path.insert(0, str(TESTS))
    from support.programs import load

    return load(name)


@cache
def _setup(name: str, dialect: str) -> Any:
    from support.programs import setup_of

    offset = _offset(_chain(name))
    place = ",".join(str(offset[axis]) for axis in "XYZ")
    return setup_of(_machine(name), [f"{'0' if dialect == 'heidenhain' else 'G54'}={place}"], [f"T1={LENGTH}"])


def _model(name: str, effects: str) -> ErrorModel:
    """The calibration as its file would be read."""
    from support.programs import model_of

    from kinematics.error_model.model import encode_model

    content = json.loads(encode_model(model_of(_machine(name))))
    content["effects"] = json.loads(effects)
    return decode_model(json.dumps(content).encode(), "calibration")
