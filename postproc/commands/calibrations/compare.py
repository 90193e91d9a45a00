"""`ncomp compare`: two calibrations of one machine, error motion by error motion."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import ncomp
from kinematics.files.inputs import true_path
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.shared import OptionalMachine, ResultOptions, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp compare before.json after.json --report change.html`\n\n"
    "`ncomp compare march.json june.json --straightness least-squares --reference X=0 --reference Z=-100 --json -`\n\n"
    "`ncomp compare old.json new.json --machine mill.toml --tool-mm 150`  for a machine that is not shipped"
)


def compare(
    *,
    a: Path = argument("A calibration.", "A.json", reads=True),
    b: Path = argument("Another calibration of the same machine.", "B.json", reads=True),
    machine: OptionalMachine,
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
    axis the means are the location errors. Effects of time, temperature or feed are listed, and not compared. Without
    --machine it is the shipped machine of A.
    """
    from calibration.reports.comparison import comparison_report
    from postproc.commands.show.terminal import console, show

    names = (str(a), str(b))
    if true_path(a) == true_path(b):
        raise UserError(f"{a} and {b} are one file: name the calibrations from before and after the change")
    with console.status("comparing"):
        result = ncomp.compare(a, b, machine, straightness=straightness, reference=reference, tool_mm=tool_mm)
    models = ncomp.load_calibration(result.machine, a), ncomp.load_calibration(result.machine, b)
    sources = {
        letter: {"file": name, "id": model.id, "made_at": model.provenance.made_at.isoformat()}
        for letter, name, model in zip("ab", names, models, strict=True)
    }
    report = comparison_report(result, models, names, f"ncomp compare {a} {b}")
    with whole_results(*others.files) as files:
        others.write({**sources, **result.json()}, report, files, (a, b))
    show(report, *others.files)
