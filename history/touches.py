"""Logs of touches that the history keeps with the results of a drift."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from kinematics.machine import Machine

CHANGING = ("crash", "service", "moved", "spindle")
"""Events behind which a machine may move by its temperatures in another way."""


class KeptLog(NamedTuple):
    """A log of touches as a measurement file, without what was implausible."""

    source: str
    """The entry of the history."""
    text: str
    start: str
    """Time of its zero, ISO 8601; empty for a log without dates."""


def kept(text: str, start: datetime.datetime | None) -> dict[str, Any]:
    """What the results of a drift contain of its log."""
    return {"text": text, "start": "" if start is None else start.isoformat()}


def earlier_logs(address: str, machine: Machine) -> list[KeptLog]:
    """The logs of the drifts of a machine, by time, since the last event that may change how it moves."""
    from sqlalchemy import select

    from history.database import opened
    from history.entries import entries_of
    from history.schema import MachineRow

    if "://" not in address and not Path(address).is_file():
        return []
    found: list[KeptLog] = []
    with opened(address, writes=False) as session:
        own = MachineRow.name == machine.name, MachineRow.chain_hash == machine.chain_hash
        row = session.scalar(select(MachineRow).where(*own))
        for entry in [] if row is None else entries_of(session, row, ("drift", *CHANGING)):
            if entry.kind in CHANGING:
                found.clear()
            elif entry.document is not None:
                log = msgspec.json.decode(entry.document, type=dict[str, Any])["log"]
                found.append(KeptLog(f"entry {entry.id} of {entry.at[:10]}", log["text"], log["start"]))
    return found
