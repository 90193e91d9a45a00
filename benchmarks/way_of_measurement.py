"""Where a measurement is passed while `calibrate` runs: the places, as pairs of a module and a function of another one.

    python benchmarks/way_of_measurement.py DATA.csv --machine cframe

A place counts once, however often it is passed. Columns and methods of the measurement itself do not count: a module
that reads a column does not hand the measurement on.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from calibration.fit.calibrate import calibrate
from calibration.measurement.file import read_measurement
from calibration.measurement.measurement import Measurement
from machines.given import load_machine

ROOT = Path(__file__).parents[1]
PASSED_ON = ("calibration/measurement/measurement.py", "calibration/registration/derived.py")
"""Modules of the measurement's own columns."""


def places(measurement: Measurement) -> set[tuple[str, str]]:
    """The module that passes the measurement, and the function of another module that gets it."""
    found = set()

    def seen(frame: FrameType, event: str, _: Any) -> None:
        code, caller = frame.f_code, frame.f_back
        if event != "call" or not code.co_filename.startswith(str(ROOT / "calibration")):
            return
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if not any(isinstance(frame.f_locals.get(name), Measurement) for name in names):
            return
        own = Path(code.co_filename).relative_to(ROOT).as_posix()
        while caller is not None and not caller.f_code.co_filename.startswith(str(ROOT / "calibration")):
            caller = caller.f_back
        by = "" if caller is None else Path(caller.f_code.co_filename).relative_to(ROOT).as_posix()
        if own not in (by, *PASSED_ON) and by not in PASSED_ON:
            found.add((by, f"{own}: {code.co_name}"))

    sys.setprofile(seen)
    try:
        calibrate(measurement, force=True)
    finally:
        sys.setprofile(None)
    return found


def main() -> None:
    """Print the places of one file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--machine", required=True)
    given = parser.parse_args()
    found = places(read_measurement(given.data, load_machine(given.machine)))
    for by, function in sorted(found):
        print(f"{by} -> {function}")
    print(f"{len(found)} places, {len({function for _, function in found})} functions")


if __name__ == "__main__":
    main()
