"""Results of a correction in numbers, collected chunk by chunk, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from postproc.compensation.conditions import Conditions
from postproc.compensation.used_datums import UsedDatums
from postproc.control.without_effect import Unused
from postproc.evaluation.predicted_errors import PredictedErrors, Statistic
from postproc.text.line_numbers import ranges
from rendering.shown import Shown


class CorrectionResult(Shown, PredictedErrors, kw_only=True):
    """The result of one run; lengths in um."""

    program: dict[str, Any]
    """Name and fingerprint of the input."""
    machine: dict[str, Any]
    """Name and chain of the machine."""
    calibration: dict[str, Any]
    """Id and origin of the calibration."""
    datums: UsedDatums
    """Datums of the work offsets that the program used."""
    blocks: int = 0
    """Number of blocks that were read."""
    moves: int = 0
    """Number of moves that were read."""
    corrected: int = 0
    """Number of moves whose end was corrected."""
    changed_blocks: int = 0
    """Number of blocks whose words were changed."""
    added_blocks: int = 0
    """Number of blocks added for backlash take-ups and for the segments of moves."""
    split_moves: int = 0
    """Number of moves written in several blocks, so that the path stays within the tolerance."""
    conversion: str = ""
    """Conversion between tool point and axes, as of `--tcp`; empty for none."""
    converted_moves: int = 0
    """Number of moves that were converted."""
    left: dict[str, list[int]] = msgspec.field(default_factory=dict)
    """Lines of feed moves with axes that are not corrected, by these axes."""
    left_outside: list[int] = msgspec.field(default_factory=list)
    """Lines of moves that stay as programmed, outside the range of the calibration."""
    conditions: Conditions = msgspec.field(default_factory=Conditions)
    """Temperatures and times of the run."""
    correction: dict[str, Statistic] = msgspec.field(default_factory=dict)
    """Corrections by linear axis, um."""
    rotary_correction: dict[str, Statistic] = msgspec.field(default_factory=dict)
    """Corrections by rotary axis, urad, if the orientation is corrected."""
    max_correction_um: float | None = None
    """Largest correction that is not refused, um; None if nothing is corrected."""
    accepted: dict[str, str] = msgspec.field(default_factory=dict)
    """Implausible conditions that were accepted: text with the value, by the name of `--accept`."""
    not_evaluated: int = 0
    """Number of moves to machine coordinates, or before the program has given all linear axes."""
    work_offsets: dict[str, str] = msgspec.field(default_factory=dict)
    """Work offsets that the program used, as text."""
    tools: dict[str, str] = msgspec.field(default_factory=dict)
    """Tool lengths that the program used, as text."""
    assumed: list[str] = msgspec.field(default_factory=list)
    """Work offsets and tools that the machine file assumes."""
    assumption: str = ""
    """`assumed` as a sentence; empty for none."""
    mark: str = ""
    """Comment that marks the corrected program; empty where it is unchanged."""
    notes: list[str] = msgspec.field(default_factory=list)
    """Notes for the user."""
    unused: list[Unused] = msgspec.field(default_factory=list)
    """Parts of the set-up that were given and not used."""

    def add_called(self, names: Sequence[str]) -> None:
        """Add the names of the files of called programs that are corrected as files."""
        if names:
            self.program["called"] = list(names)
            self.notes.insert(0, f"called programs, corrected in files beside the program: {', '.join(names)}")

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return (
            f"{self.changed_blocks} of {self.blocks} blocks changed, {self.added_blocks} added, {self.error} at most "
            f"{self.before.largest:.3g} -> {self.after.largest:.3g} um"
        )

    @property
    def relative(self) -> str:
        """Text on the reference of the errors; empty if all work offsets are true and errors are absolute."""
        return "relative to the datum" if self.datums.used else ""

    @property
    def error(self) -> str:
        """Name of the error: relative to the datum, unless all work offsets are true."""
        return f"error {self.relative}".strip()

    def json(self) -> dict[str, Any]:
        """The machine-readable form; every length in um."""
        return {
            "program": self.program,
            "mark": self.mark,
            "machine": self.machine,
            "calibration": self.calibration,
            "conditions": self.conditions.json(),
            "blocks": {"read": self.blocks, "changed": self.changed_blocks, "added": self.added_blocks},
            "moves": {
                "read": self.moves,
                "corrected": self.corrected,
                "split": self.split_moves,
                "not_judged": self.not_evaluated,
                **({"converted": self.converted_moves} if self.conversion else {}),
            },
            "not_split": [not_split.json(reason) for reason, not_split in self.not_split.items()],
            "not_corrected": [{"axes": axes.split(), "lines": ranges(lines)} for axes, lines in self.left.items()],
            "left_outside": {"moves": len(self.left_outside), "lines": ranges(self.left_outside)},
            "correction_um": {axis: statistic.json() for axis, statistic in self.correction.items()},
            "correction_urad": {axis: statistic.json() for axis, statistic in self.rotary_correction.items()},
            "max_correction_um": None if self.max_correction_um is None else round(self.max_correction_um, 4),
            "accepted": self.accepted,
            "predicted_error_um": {
                "before": self.before.json(),
                "after": self.after.json(),
                "between_block_ends_after": self.between_ends.json(),
                "anywhere": self.anywhere.json(),
                "standard_uncertainty_of_prediction": self.uncertainty.json(),
                "significant_share_of_improvement": self.significance.share,
            },
            "predicted_absolute_error_um": {"before": self.absolute_before.json(), "after": self.absolute_after.json()},
            "predicted_tool_axis_error_urad": {"before": self.tilt_before.json(), "after": self.tilt_after.json()},
            "work_offsets": self.work_offsets,
            "errors_relative_to": "datum" if self.relative else "work offset",
            "datum": self.datums.json(self.work_offsets),
            "tools": self.tools,
            "assumed": self.assumed,
            "notes": self.notes,
        }
