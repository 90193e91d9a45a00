"""`ncomp measure`: asks for the lengths of a rectangle one by one, and says what is wrong with the machine."""

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
) -> None:
    """Ask for the lengths of a rectangle that the machine marks, and say what is wrong in mm per 300 mm.

    Each question is for the length that helps most. Answers may come from a pipe. The file is for ncomp fit.
    """
    from calibration.planning.next_length import Corners

    found = ncomp.load_machine(machine)
    sides = None if size is None else numbers(size, 2, f"--size {size}")
    corners = Corners.within(found, plane, None if sides is None else (sides[0], sides[1]))
    session = Session(found, corners, u, ruler_um_per_m)
    session.begin()
    while (name := session.next_length()) is not None and session.ask(name):
        pass
    if not session.lengths:
        raise UserError("no length was given: nothing is written")
    with whole_results(output) as (file,):
        file.write(session.text.encode())
    _say(f"Written: {output}, {len(session.lengths)} lengths. Next: ncomp fit {output} --machine {machine} -o CAL.json")


@dataclass
class Session:
    """The lengths that were given so far."""

    machine: Machine
    corners: Corners
    u: float
    ruler_um_per_m: float | None
    lengths: dict[str, float] = field(default_factory=dict)
    """mm, by name."""
    left_out: set[str] = field(default_factory=set)

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
        return file_of(self.machine, corners.plane, corners.places, self.lengths, self.u, self.ruler_um_per_m)

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
        model: ErrorModel = ncomp.fit(measurement, hold_out=False).model
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
