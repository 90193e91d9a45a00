"""Writing of continuous runs (contract 4.2)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import BinaryIO

from calibration.continuous.records import Record
from calibration.measurement.states import MADE_BY
from kinematics.version import VERSION

WRITTEN_RECORDS = 50_000


def write_records(records: Sequence[Record], axis: str, machine: str, file: BinaryIO, origin: str = "") -> None:
    """Write runs over the same travel; several runs have columns `run` and `direction`.

    origin: of the data, for the header line `made_by`.
    """
    first = records[0]
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    for key, value in (
        ("machine", machine),
        ("axis", axis),
        ("start_mm", f"{first.start:g}"),
        ("end_mm", f"{first.end:g}"),
        ("feed_mm_min", f"{first.feed:g}"),
        (MADE_BY, f"ncomp {VERSION}{origin}"),
    ):
        text.write(f"# {key}: {value}\n")
    several = len(records) > 1
    text.write("time_s,displacement_mm,run,direction\n" if several else "time_s,displacement_mm\n")
    for record in records:
        tail = f",{record.name.split()[0]},{'+' if record.direction > 0 else '-'}" if several else ""
        for start in range(0, len(record), WRITTEN_RECORDS):
            rows = slice(start, start + WRITTEN_RECORDS)
            pairs = zip(record.time[rows].tolist(), record.displacement[rows].tolist(), strict=True)
            text.writelines(f"{time:.6f},{shown:.6f}{tail}\n" for time, shown in pairs)
    text.flush()
    text.detach()
