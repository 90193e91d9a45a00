"""`ncomp compare`: two calibrations of one machine, error motion by error motion."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.shared import (
    ResultOptions,
    check_files,
    machine_names,
    whole_results,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine

EPILOG = (
    "Examples:\n\n"
    "`ncomp compare before.json after.json --report change.html`\n\n"
    "`ncomp compare march.json june.json --straightness least-squares --reference X=0 --reference Z=-100 --json -`\n\n"
    "`ncomp compare old.json new.json --machine mill.toml --tool-mm 150`  for a machine that is not shipped"
)


def compare(
    *,
    a: Path = argument("A calibration.", "A.json"),
    b: Path = argument("Another calibration of the same machine.", "B.json"),
    machine: str | None = option(
        "Name of the machine, or path of its .toml file; default: the shipped machine of A.",
        None,
        "-m",
        complete=machine_names,
    ),
    straightness: Literal["end-point", "least-squares"] = option(
        "Reference straight line of the straightness.", default="end-point"
    ),
    reference: tuple[str, ...] = option(
        "Position of an axis, mm or degrees, where its errors are zero; default: its home position.", "X=mm"
    ),
    tool_mm: float = option("Length of the tool in the volume, mm.", "mm", default=100.0, min=0.0),
    others: ResultOptions,
) -> None:
    """Compare two calibrations in the conventions of ISO 230-1: by error motion, squareness, and over the volume.

    Differences are B minus A, U is their expanded uncertainty (k = 2). Positioning and angles are zero at the
    reference position, straightness is relative to its reference line, and its slope is in the squareness; for a rotary
    axis the means are the location errors. Effects of time, temperature or feed are listed, and not compared.
    """
    from calibration.evaluation.comparison.compare import compare as compared
    from calibration.reports.comparison import comparison_report
    from postproc.commands.show.terminal import console, show

    inputs = check_files((a, b), others.by_option)
    found, models = _read(a, b, machine)
    names = (str(a), str(b))
    with console.status("comparing"):
        result = compared(found, models, straightness, _references(found, reference), tool_mm)
    sources = {
        letter: {"file": name, "id": model.id, "made_at": model.provenance.made_at.isoformat()}
        for letter, name, model in zip("ab", names, models, strict=True)
    }
    report = comparison_report(result, models, names, f"ncomp compare {a} {b}")
    with whole_results(*others.files) as files:
        others.write({**sources, **result.json()}, report, files, inputs)
    show(report, *others.files)


def _read(a: Path, b: Path, name: str | None) -> tuple[Machine, tuple[ErrorModel, ErrorModel]]:
    """Both calibrations and their machine; UserError where they are of different machines."""
    import machines as shipped
    from kinematics.error_model.model import decode_model, read_model
    from kinematics.files import read_input

    first, second = (decode_model(read_input(path, "calibration"), str(path)).machine for path in (a, b))
    if first.chain_hash != second.chain_hash:
        geometry = " with another geometry" if (first.name, first.chain) == (second.name, second.chain) else ""
        raise UserError(
            f"{a} is of machine {first.name} ({first.chain}), {b} of {second.name} ({second.chain}){geometry}: only "
            "calibrations of one machine can be compared"
        )
    if name is None and first.name not in shipped.names():
        raise UserError(f"{a}: machine {first.name} is not shipped; give its file with --machine FILE.toml")
    machine = ncomp.load_machine(name or first.name)
    return machine, (read_model(a, machine), read_model(b, machine))


def _references(machine: Machine, texts: Sequence[str]) -> dict[str, float]:
    """Reference positions by axis, mm or degrees."""
    from math import isfinite

    found: dict[str, float] = {}
    for text in texts:
        axis, equals, value = (part.strip() for part in text.partition("="))
        try:
            position = float(value)
        except ValueError:
            position = float("nan")
        if not equals or not isfinite(position):
            raise UserError(f"--reference {text}: expected AXIS=POSITION, as in X=0")
        if axis not in machine.names:
            raise UserError(f"--reference {text}: {machine.name} ({machine.chain}) has no axis {axis}")
        if axis in found:
            raise UserError(f"--reference {text}: {axis} is given twice: give it once")
        found[axis] = position
    return found
