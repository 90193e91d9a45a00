"""Entries: results and events of machines, and the rules by which they are entered."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from kinematics.files import fingerprint
from kinematics.files.mistaken import did_you_mean
from kinematics.machine import Machine
from kinematics.user_error import UserError
from kinematics.version import VERSION

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

    from history.schema import Entry, MachineRow

EVENTS = ("crash", "service", "moved", "spindle", "other")
"""What can happen to a machine: `moved` to another place, a new `spindle`."""
KINDS = (
    *("calibration", "diagnosis", "iso230-2", "iso230-4", "etve", "check", "measurement", "parameters", "tables"),
    *("drift", "program"),
)
"""Kinds of results."""
CLOCKS_DIFFER_S = 300
"""Time by which the clocks of a network may differ, s: as Kerberos allows (RFC 4120)."""


class Quantity(NamedTuple):
    """A number that a result gives."""

    name: str
    """`squareness X-Y`, `backlash X`, `A X`."""
    unit: str
    value: float
    u: float
    """Standard uncertainty, k = 1."""


class FoundCause(NamedTuple):
    """A cause of errors that a diagnosis has found."""

    name: str
    """Kind and axis: `backlash X`."""
    verdict: str
    """`strong`, `weak` or `tied`."""
    log10_odds: float
    """Against none."""
    sizes: list[dict[str, Any]]
    """For each parameter: `name` with its unit, `value`, `u` (k = 1), `before`.

    `value` is the change, if the calibration before has this cause with the value `before`; otherwise the whole size.
    """


@dataclass(frozen=True, kw_only=True)
class Result:
    """A result or an event before it is entered."""

    kind: str
    at: datetime.datetime
    """Point of time for which it holds, with its time zone."""
    title: str
    method: str = ""
    """Instrument or test."""
    document: bytes | None = None
    figures: Sequence[Quantity] = ()
    causes: Sequence[FoundCause] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    """Fingerprints of files by their paths."""


def utc(moment: datetime.datetime) -> str:
    """A point of time as the database has it."""
    return moment.astimezone(datetime.UTC).isoformat(timespec="microseconds")


def moment_of(text: str, where: str) -> datetime.datetime:
    """The point of time in a date, or in a date with a clock time; local where it states no zone."""
    try:
        return datetime.datetime.fromisoformat(text.strip()).astimezone()
    except ValueError:
        raise UserError(f"{where} {text}: expected a date such as 2026-03-01, or 2026-03-01T14:30") from None


def enter(session: Session, machine: Machine, result: Result, *, force: bool = False) -> Entry:
    """Enter a result of a machine; UserError where a rule speaks against it. force: whatever the clock says."""
    from history.schema import CauseRow, Entry, FigureRow, FileRow

    row = _row_of(session, machine)
    now = datetime.datetime.now(datetime.UTC)
    if not force:
        _refuse_wrong_clock(session, result, now)
    content = "" if result.document is None else fingerprint(result.document)
    _refuse_same(session, row, machine, result)
    entry = Entry(
        kind=result.kind, at=utc(result.at), entered_at=utc(now), title=result.title, method=result.method,
        made_by=f"ncomp {VERSION}", document=result.document, fingerprint=content, machine=row,
        figures=[FigureRow(**each._asdict()) for each in result.figures],
        causes=[CauseRow(**each._asdict()) for each in result.causes],
        files=[FileRow(path=str(Path(path).absolute()), fingerprint=own) for path, own in result.files.items()],
    )  # fmt: skip
    session.add(entry)
    session.flush()
    return entry


def _row_of(session: Session, machine: Machine) -> MachineRow:
    """The row of a machine, also of a new one; UserError for another geometry of the same name."""
    from sqlalchemy import select

    from history.schema import MachineRow

    row = session.scalar(select(MachineRow).where(MachineRow.name == machine.name))
    if row is None:
        return MachineRow(name=machine.name, chain=machine.chain, chain_hash=machine.chain_hash)
    if row.chain_hash != machine.chain_hash:
        raise UserError(
            f"machine {machine.name} ({machine.chain}) has another geometry than the machine of this name in the "
            f"history ({row.chain}): give its file another name = ... to begin a life of its own"
        )
    return row


def _refuse_wrong_clock(session: Session, result: Result, now: datetime.datetime) -> None:
    """UserError for a time in the future, and where the clock is behind the entries of all machines."""
    from sqlalchemy import func, select

    from history.schema import Entry

    differ = datetime.timedelta(seconds=CLOCKS_DIFFER_S)
    latest = session.scalar(select(func.max(Entry.entered_at)))
    if latest is not None and utc(now + differ) < latest:
        raise UserError(
            f"the clock of this computer says {_day(utc(now))}, and the last entry was made at {_day(latest)}: set the "
            "clock; --force enters nevertheless"
        )
    if result.at > now + differ:
        raise UserError(
            f"{result.title}: {_day(utc(result.at))} is in the future: give its date with --at, or set the clock; "
            "--force enters nevertheless"
        )


def data_of(files: Iterable[tuple[str, str]]) -> frozenset[str]:
    """The fingerprints of data, from the paths and fingerprints of files: calibrations and results are JSON."""
    return frozenset(known for path, known in files if not path.lower().endswith(".json"))


def same_as(session: Session, machine: Machine, result: Result) -> Entry | None:
    """The entry that has the same document; None where there is none."""
    from sqlalchemy import select

    from history.schema import Entry, MachineRow

    if result.document is None:
        return None
    own = select(Entry).join(MachineRow).where(MachineRow.name == machine.name, Entry.kind == result.kind)
    return session.scalar(own.where(Entry.fingerprint == fingerprint(result.document)))


def _refuse_same(session: Session, row: MachineRow, machine: Machine, result: Result) -> None:
    """UserError for a result that the history has, and for another one of the same instant from other data."""
    from sqlalchemy import select

    from history.schema import Entry

    if (same := same_as(session, machine, result)) is not None:
        raise UserError(f"{result.title}: the history has it already, as entry {same.id} of {_day(same.at)}")
    if not result.figures and result.kind not in EVENTS:
        return
    of_instant = Entry.machine_id == row.id, Entry.kind == result.kind, Entry.at == utc(result.at)
    for other in session.scalars(select(Entry).where(*of_instant)):
        data = data_of((file.path, file.fingerprint) for file in other.files)
        if not data or data != data_of(result.files.items()):
            file = "" if result.kind == "check" else "write this one into a file, and "
            raise UserError(
                f"{result.title}: entry {other.id} ({other.title}) is another {result.kind} of the same instant, "
                f"{_day(other.at)}: {file}enter it by 'ncomp history add' with the date and the time, "
                f"--at {other.at[:10]}T14:30"
            )


def _day(moment: str) -> str:
    """Date and time to the minute."""
    return f"{moment[:16].replace('T', ' ')} UTC"


def machine_named(session: Session, name: str) -> MachineRow:
    """The machine of a name in the history; UserError for none."""
    from sqlalchemy import select

    from history.schema import MachineRow

    rows = {row.name: row for row in session.scalars(select(MachineRow).order_by(MachineRow.name))}
    if name not in rows:
        known = f"it has {', '.join(rows)}{did_you_mean(name, rows)}" if rows else "it has none"
        raise UserError(f"the history has no machine {name!r}: {known}")
    return rows[name]


class Life(NamedTuple):
    """The number of entries of a machine, and the dates of the first and the last one."""

    machine: str
    entries: int
    first: str
    last: str


def lives(session: Session) -> list[Life]:
    """All machines by their names."""
    from sqlalchemy import func, select

    from history.schema import Entry, MachineRow

    columns = MachineRow.name, func.count(Entry.id), func.min(Entry.at), func.max(Entry.at)
    found = session.execute(select(*columns).join(Entry).group_by(MachineRow.name).order_by(MachineRow.name))
    return [Life(*row) for row in found]


def entries_of(session: Session, machine: MachineRow | None = None, kinds: Iterable[str] = ()) -> Sequence[Entry]:
    """The entries of a machine, or of all machines, by time."""
    from sqlalchemy import select
    from sqlalchemy.orm import selectinload

    from history.schema import Entry

    parts = selectinload(Entry.figures), selectinload(Entry.files), selectinload(Entry.causes)
    chosen = select(Entry).options(*parts).order_by(Entry.at, Entry.id)
    if machine is not None:
        chosen = chosen.where(Entry.machine_id == machine.id)
    if kinds := tuple(kinds):
        chosen = chosen.where(Entry.kind.in_(kinds))
    return session.scalars(chosen).all()


State = Literal["as entered", "changed", "gone"]


class Checked(NamedTuple):
    """The state of a file, or of a document, of an entry."""

    entry: int
    name: str
    state: State
    found: str
    """Its present fingerprint; empty for one that is gone."""


def check_files(entries: Iterable[Entry]) -> list[Checked]:
    """The state of all that entries name or contain, against the fingerprints with which they were entered."""
    found = []
    for entry in entries:
        if entry.document is not None:
            now = fingerprint(entry.document)
            found.append(Checked(entry.id, "document", "as entered" if now == entry.fingerprint else "changed", now))
        for file in entry.files:
            now, state = _state(Path(file.path), file.fingerprint)
            found.append(Checked(entry.id, file.path, state, now))
    return found


def _state(path: Path, entered: str) -> tuple[str, State]:
    try:
        now = fingerprint(path.read_bytes())
    except OSError:
        return "", "gone"
    return now, "as entered" if now == entered else "changed"
