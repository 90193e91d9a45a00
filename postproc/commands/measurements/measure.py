"""`ncomp measure`: asks for lengths and dial readings one by one, and says what is wrong with the machine."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import ncomp
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.options.declared import option, output_option
from postproc.commands.options.shared import MachineName, whole_results

if TYPE_CHECKING:
    from calibration.planning.next_length import Corners
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine

EPILOG = (
    "Examples:\n\n"
    "`ncomp measure --machine router.toml -o lengths.csv`\n\n"
    "`ncomp measure --machine router.toml --size 600,600 --u 0.25 --ruler-um-per-m 200 -o lengths.csv`\n\n"
    "then `ncomp fit lengths.csv --machine router.toml -o router.json`"
)
PLACE = re.compile(r"^lengths: (line \d+: )?")
"""Name of the table and line in a message: the user has not seen it."""
DIAL = "axis,along,position_mm,direction,reading_um,run"
"""Columns of readings of a dial gauge."""
HELP = "a length in mm; - for one that cannot be measured; drop AC to take one back; nothing to end"
"""What may be answered."""


def measure(
    *,
    machine: MachineName,
    output: str = output_option("File for the lengths, for ncomp fit.", "DATA.csv"),
    plane: Literal["XY", "XZ", "YZ"] = option("Plane of the rectangle.", default="XY"),
    size: str | None = option("Sides of the rectangle along the two axes, mm; default: most of the travel.", "MM,MM"),
    u: float = option("Standard uncertainty (k=1) of a length, mm.", "MM", default=0.5, min=1e-3),
    ruler_um_per_m: float | None = option(
        "Standard uncertainty (k=1) of the scale of the ruler, um/m. Default: not known.", "NUMBER", min=1e-3
    ),
    gauge_um: float | None = option(
        "Standard uncertainty (k=1) of a dial gauge, um: with it, ask for the backlash of both axes too.",
        "um",
        min=1e-3,
    ),
) -> None:
    """Ask for the lengths of a rectangle that the machine marks, and say what is wrong in mm per 300 mm.

    Each question is for the length that helps most; with a dial gauge, backlash comes last. Answers may come from a
    pipe. The file is for ncomp fit.
    """
    from calibration.planning.next_length import Corners

    found = ncomp.load_machine(machine)
    sides = None if size is None else numbers(size, 2, f"--size {size}")
    corners = Corners.within(found, plane, None if sides is None else (sides[0], sides[1]))
    session = Session(found, corners, u, ruler_um_per_m, gauge_um)
    session.begin()
    while (name := session.next_length()) is not None and session.ask(name):
        pass
    if gauge_um is not None:
        session.ask_backlash()
    if not session.lengths and not session.readings:
        raise UserError("no length was given: nothing is written")
    with whole_results(output) as (file,):
        file.write(session.text.encode())
    given = f"{len(session.lengths)} lengths, {len(session.readings)} readings of the dial gauge"
    _say(f"Written: {output}, {given}. Next: ncomp fit {output} --machine {machine} -o CAL.json")


@dataclass
class Session:
    """The lengths that were given so far."""

    machine: Machine
    corners: Corners
    u: float
    ruler_um_per_m: float | None
    gauge_um: float | None = None
    lengths: dict[str, float] = field(default_factory=dict)
    """mm, by name."""
    left_out: set[str] = field(default_factory=set)
    readings: list[str] = field(default_factory=list)
    """Rows of the dial gauge."""

    def begin(self) -> None:
        """Say where to make the marks."""
        first, second = self.corners.plane[0], self.corners.plane[1]
        _say("Mark four points: prick, drill or scratch them in the same way, and come to each from the same side.")
        for letter, (x, y) in self.corners.places.items():
            _say(f"  {letter}: {first} {x:g}  {second} {y:g}")
        _say(f"Then measure between them. Answer {HELP}.")

    @property
    def text(self) -> str:
        """The lengths as a measurement file."""
        from calibration.evaluation.rectangle import file_of

        corners = self.corners
        text = file_of(self.machine, corners.plane, corners.places, self.lengths, self.u, self.ruler_um_per_m)
        if not self.readings:
            return text
        lines = text.splitlines()
        head = [line for line in lines if line.startswith("#")]
        names, *rows = lines[len(head) :]
        beside = "," * DIAL.count(",")
        rows = [f"{names},{DIAL}", *(f"{row},{beside}" for row in rows)]
        rows += [f"{',' * names.count(',')},{row}" for row in self.readings]
        return "\n".join([*head, f"# u_gauge_um: {self.gauge_um:g}", *rows]) + "\n"

    def next_length(self) -> str | None:
        """The length to ask for; None where all are there."""
        from calibration.planning.next_length import RULER

        ruler = RULER if self.ruler_um_per_m is None else self.ruler_um_per_m * 1e-6
        return self.corners.next_length(self.lengths, self.left_out, self.u, ruler)

    def ask(self, name: str) -> bool:
        """Ask for a length until an answer can be used; False where the user ends."""
        question = f"From {name[0]} to {name[1]}, about {self.corners.distance(name):.1f} mm: "
        while True:
            answer = _answer(question)
            if not answer:
                return False
            try:
                self._take(name, answer)
            except UserError as fault:
                _say(f"  {PLACE.sub('', str(fault))}")
                continue
            return True

    def ask_backlash(self) -> None:
        """Ask for readings of a dial gauge after a turn back of each axis, twice; nothing leaves an axis out."""
        for axis, low, side in zip(self.corners.plane, self.corners.low, self.corners.size, strict=True):
            at = round(low + side / 2.0)
            _say(f"Backlash of {axis}: set the dial gauge against something fixed, its plunger along {axis}.")
            for run in (f"backlash {axis} 1", f"backlash {axis} 2"):
                _say(f"  Move {axis} to {at - 1}, then up to {at}, and set the dial to zero.")
                question = f"  Move {axis} up to {at + 1} and back to {at}. Dial, mm (+ where {axis} is too far in +): "
                if not self._took_reading(question, axis, at, run):
                    break

    def _took_reading(self, question: str, axis: str, at: int, run: str) -> bool:
        """Ask for a reading until it can be used; False for nothing."""
        while answer := _answer(question):
            before = list(self.readings)
            try:
                (reading,) = numbers(answer, 1, answer)
                self.readings += [f"{axis},{axis},{at},+,0,{run}", f"{axis},{axis},{at},-,{reading * 1e3:g},{run}"]
                self._show()
                return True
            except UserError as fault:
                self.readings = before
                _say(f"  {PLACE.sub('', str(fault))}")
        return False

    def _take(self, name: str, answer: str) -> None:
        """Use an answer; UserError for one that cannot be used."""
        first, _, other = answer.partition(" ")
        if answer == "-":
            self.left_out.add(name)
        elif first.lower() == "drop":
            if other.strip().upper() not in self.lengths:
                raise UserError(f"{answer}: there is {', '.join(self.lengths) or 'nothing'} to take back")
            del self.lengths[other.strip().upper()]
        else:
            (length,) = numbers(answer, 1, answer)
            self.lengths[name] = length
            try:
                self._show()
            except UserError:
                del self.lengths[name]
                raise

    def _show(self) -> None:
        """Say what the lengths show so far; UserError where they are none, or contradict each other."""
        from calibration.reports.rectangle_readings import sentences

        for sentence in sentences(self._fitted(), self.corners.plane):
            _say(f"  {sentence}")

    def _fitted(self) -> ErrorModel:
        """The model by the lengths."""
        from calibration.measurement.file import measurement_of
        from calibration.measurement.text_table import parse_table

        measurement = measurement_of(parse_table(self.text.encode(), "lengths"), self.machine)
        model: ErrorModel = ncomp.fit(measurement, hold_out=False, force=True).model
        return model


def _answer(question: str) -> str:
    """The answer to a question; empty at the end of the input."""
    print(question, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline() if sys.stdin is not None else ""
    if sys.stdin is not None and not sys.stdin.isatty():
        _say(line.strip())
    return line.strip()


def _say(text: str) -> None:
    print(text, file=sys.stderr)
