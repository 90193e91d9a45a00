"""`ncomp square`: squareness of two axes from the diagonals and a side of a rectangle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import ncomp
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, option
from postproc.commands.options.recorded import RecordedOptions, calibration_entry
from postproc.commands.options.shared import OptionalMachine, whole_results

if TYPE_CHECKING:
    from calibration.evaluation.rectangle import Rectangle

EPILOG = (
    "A is the corner from which AD goes along +X and AB along +Y; C is opposite to A:\n\n"
    "`B------C`\n\n`|      |`\n\n`A------D`\n\n"
    "Examples:\n\n"
    "`ncomp square --ac 319 --bd 318 --ad 199`\n\n"
    "`ncomp square --ac 141.22 --bd 141.15 --ad 100 --u 0.05 --machine router.toml -o router.json`\n\n"
    "`ncomp square --ac 851 --bd 846.5 --ad 600 --ab 600.5 --u 0.3 --machine router.toml -o router.json`"
)


@dataclass(frozen=True, kw_only=True)
class LengthOptions:
    """Lengths of the rectangle."""

    PANEL: ClassVar[str] = "Lengths"

    ac: float = option("Diagonal from A to C.", "MM", default=REQUIRED)
    bd: float = option("Diagonal from B to D.", "MM", default=REQUIRED)
    ad: float = option("Side from A to D, along the first axis of the plane.", "MM", default=REQUIRED)
    ab: float | None = option("Side from A to B: it checks the other lengths.", "MM")
    u: float = option("Standard uncertainty (k=1) of each length.", "MM", default=0.5)
    plane: Literal["XY", "XZ", "YZ"] = option("Plane of the rectangle.", default="XY")


def square(
    *,
    lengths: LengthOptions,
    size: str | None = option(
        "Sides that the machine was commanded, along the two axes of the plane: for a measurement file.", "MM,MM"
    ),
    machine: OptionalMachine,
    output: str | None = option(
        "File for the calibration; needs --machine. FILE.csv is a measurement file for ncomp fit; needs --size too.",
        "CAL.json",
        "-o",
        writes="file",
    ),
    others: RecordedOptions,
) -> None:
    """Find how far two axes are from square, from the diagonals and one side of a rectangle that the machine made.

    The result is in mm per 300 mm and in urad, with its uncertainty, and says which way the corner opens. The
    calibration corrects this error alone: lengths for scales as well are fitted by ncomp fit
    (docs/measurements/lengths.md).
    """
    from calibration.reports.rectangle import notes_on, rectangle_json, rectangle_report
    from postproc.commands.show.terminal import say, show

    found = ncomp.square(**vars(lengths))
    content = _content(found, size, machine, output)
    given = " ".join(f"--{name} {value}" for name, value in vars(lengths).items() if value is not None)
    report = rectangle_report(found, f"ncomp square {given}")
    for note in notes_on(found):
        say("note", note)
    mill = None if machine is None else ncomp.load_machine(machine)
    with others.recorded(mill) as record, whole_results(output, *others.files) as (file, *files):
        file.write(content)
        others.write(rectangle_json(found), report, tuple(files), [machine])
        if mill is not None and not _is_table(output):
            title = f"squareness by the lengths of a rectangle, {found.headline}"
            record(calibration_entry(mill, content, output, report, (), kind="check", title=title))
    show(report, *others.files)


def _is_table(output: str | None) -> bool:
    """True for the name of a measurement file."""
    return output is not None and output.lower().endswith(".csv")


def _content(found: Rectangle, size: str | None, machine: str | None, output: str | None) -> bytes:
    """Content of the output: the calibration, or the measurement file; UserError where an option is missing."""
    from calibration.evaluation.rectangle import file_of
    from kinematics.error_model.model import encode_model

    as_table = _is_table(output)
    if size is not None and not as_table:
        raise UserError(f"--size {size}: is for a measurement file: give -o FILE.csv")
    if machine is None:
        if output is not None:
            raise UserError(f"-o {output}: it belongs to a machine: give --machine too")
        return b""
    mill = ncomp.load_machine(machine)
    if not as_table:
        return encode_model(found.calibration(mill))
    if size is None:
        raise UserError(f"-o {output}: the measurement file has the sides that were commanded: give --size MM,MM")
    across, along = numbers(size, 2, f"--size {size}")
    if min(across, along) <= 0.0:
        raise UserError(f"--size {size}: the sides are above 0, mm")
    places = {"A": (0.0, 0.0), "B": (0.0, along), "C": (across, along), "D": (across, 0.0)}
    measured = {name.upper(): length for name, length in found.lengths.items() if length}
    return file_of(mill, found.plane, places, measured, found.u).encode()
