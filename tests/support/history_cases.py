"""Calibrations for the history of a machine, and its entries."""

from __future__ import annotations

import datetime
import json
from pathlib import Path

import msgspec

from kinematics.effects import LocationError
from kinematics.error_model.model import encode_model, no_errors
from machines import load
from support.command import succeed


def calibration(
    path: Path, angle: float = 20.0, machine: str = "cframe", day: str = "2026-03-01", **changes: str
) -> Path:
    """A calibration of one squareness, in um/m, with u = 2."""
    mill = load(machine)
    effect = LocationError("C", "Y", angle, u=(2.0,))
    model = msgspec.structs.replace(no_errors(mill), effects=(effect,))
    made = msgspec.structs.replace(model.provenance, measured_on=datetime.date.fromisoformat(day))
    reference = msgspec.structs.replace(model.machine, **changes)
    path.write_bytes(encode_model(msgspec.structs.replace(model, provenance=made, machine=reference)))
    return path


def entries(db: str, machine: str = "cframe") -> list[dict]:
    """The entries of a machine, as JSON."""
    return json.loads(succeed("history", "list", machine, "--db", db, "--json", "-").out)["entries"]
