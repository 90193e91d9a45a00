"""The tables of the database.

A point of time is text, ISO 8601 in UTC with microseconds, which sorts by time in every database.
"""

from __future__ import annotations

from typing import Any, Final

from sqlalchemy import JSON, Double, ForeignKey, Index, LargeBinary
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

VERSION: Final = "2"
"""Version of these tables: the revision of the last file in `migrations/versions`, which makes them."""


class Base(DeclarativeBase):
    """All tables."""


class MachineRow(Base):
    """A machine of the shop."""

    __tablename__ = "machine"

    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    chain: Mapped[str]
    chain_hash: Mapped[str]


class Entry(Base):
    """A result or an event of a machine."""

    __tablename__ = "entry"
    __table_args__ = (Index("entry_of_machine", "machine_id", "at"), Index("entry_of_time", "entered_at"))

    id: Mapped[int] = mapped_column(primary_key=True)
    machine_id: Mapped[int] = mapped_column(ForeignKey("machine.id"))
    kind: Mapped[str]
    at: Mapped[str]
    """Point of time for which it holds: of the measurement, of the event."""
    entered_at: Mapped[str]
    title: Mapped[str]
    method: Mapped[str]
    """Instrument or test that gave its figures; empty where it has none."""
    made_by: Mapped[str]
    """Program and its version that entered it."""
    document: Mapped[bytes | None] = mapped_column(LargeBinary, deferred=True)
    """Content of the calibration, or the results as JSON."""
    fingerprint: Mapped[str]
    """Fingerprint of the document; empty without one."""
    machine: Mapped[MachineRow] = relationship(lazy="joined")
    figures: Mapped[list[FigureRow]] = relationship(order_by="FigureRow.id")
    files: Mapped[list[FileRow]] = relationship(order_by="FileRow.id")
    causes: Mapped[list[CauseRow]] = relationship(order_by="CauseRow.id")


class FigureRow(Base):
    """A number that an entry gives, with its uncertainty."""

    __tablename__ = "figure"
    __table_args__ = (Index("figure_of_name", "name", "entry_id"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    entry_id: Mapped[int] = mapped_column(ForeignKey("entry.id"), index=True)
    name: Mapped[str]
    unit: Mapped[str]
    value: Mapped[float] = mapped_column(Double)
    u: Mapped[float] = mapped_column(Double)
    """Standard uncertainty, k = 1."""


class FileRow(Base):
    """A file that an entry names."""

    __tablename__ = "file"

    id: Mapped[int] = mapped_column(primary_key=True)
    entry_id: Mapped[int] = mapped_column(ForeignKey("entry.id"), index=True)
    path: Mapped[str]
    """Absolute path."""
    fingerprint: Mapped[str]


class CauseRow(Base):
    """A cause of errors that a diagnosis has found, or one whose size has changed since the calibration before it."""

    __tablename__ = "cause"

    id: Mapped[int] = mapped_column(primary_key=True)
    entry_id: Mapped[int] = mapped_column(ForeignKey("entry.id"), index=True)
    name: Mapped[str]
    """Kind and axis: `backlash X`."""
    verdict: Mapped[str]
    """`strong`, `weak` or `tied`."""
    log10_odds: Mapped[float] = mapped_column(Double)
    """Against none."""
    sizes: Mapped[list[dict[str, Any]]] = mapped_column(JSON)
    """For each parameter: `name` with its unit, `value`, `u` (k = 1), `before`.

    `value` is the change, if the calibration before has this cause with the value `before`; otherwise the whole size.
    """
