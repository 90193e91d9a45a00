"""The details of a certificate that only its laboratory knows: a small TOML file."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import msgspec

from kinematics.files import read_input
from kinematics.files.toml_entries import at_line, entry, read_table, utf8_text
from kinematics.user_error import UserError

Rule = Literal["guard band", "simple acceptance"]
_NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

COLDEST_DEGC, HOTTEST_DEGC = 5, 40
"""Ambient temperatures, degC, at which the electrical equipment of machines works, by IEC 60204-1, 4.4.3."""


class Contact(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A company."""

    name: str
    city: str
    street: str = ""
    post_code: str = ""
    country: str = ""
    """Code by ISO 3166-1, DE."""
    email: str = ""
    phone: str = ""
    code: str = ""
    """Number of the accreditation of a laboratory."""


class Item(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The machine."""

    name: str
    """Its name in ncomp."""
    serial_number: str
    manufacturer: str = ""
    model: str = ""


class Instrument(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An instrument, and the certificate by which it is traceable."""

    name: str
    number: str
    certificate: str
    """Number of its own certificate."""
    manufacturer: str = ""
    model: str = ""
    valid_until: datetime.date | None = None
    """Last day on which its certificate is valid."""


class Person(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A person who is responsible; the first one signs."""

    name: str
    role: str = ""
    email: str = ""


class Head(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The certificate itself."""

    identifier: str
    country: str
    """Country in which it is issued, by ISO 3166-1: DE."""
    begin: datetime.date
    end: datetime.date
    """First and last day of the measurement."""
    issued: datetime.date
    temperatures_degC: tuple[float, float] | None = None  # noqa: N815  its unit
    """Lowest and highest temperature of the place; needed where the result does not have it."""
    place: Literal["customer", "laboratory", "customerBranch", "laboratoryBranch", "other"] = "customer"
    """Where the machine was measured."""
    limits: tuple[str, ...] = ()
    """`squareness X-Y=0.02mm/300mm`: a statement of conformity on each."""
    decision_rule: Rule | None = None
    """How the uncertainty counts in the statements of conformity."""
    remarks: str = ""


class Details(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All details."""

    certificate: Head
    laboratory: Contact
    customer: Contact
    machine: Item
    instrument: tuple[Instrument, ...]
    person: tuple[Person, ...]


def read_details(path: Path) -> Details:
    """The details in a TOML file; UserError with the line of the entry that is wrong, or the key that is missing."""
    where = f"details {path}"
    text = utf8_text(read_input(path, "details of a certificate"), where)
    table = read_table(text, where)
    try:
        _refuse_texts(table)
        found = entry(table, Details)
        for fault in _faults(found):
            raise UserError(fault)
    except UserError as fault:
        raise at_line(text, where, fault) from None
    return found


def _refuse_texts(value: Any, path: str = "") -> None:
    """UserError for an empty text, and for one with characters that XML does not have."""
    if isinstance(value, str):
        if value != value.strip() or not value:
            raise UserError(f"{path}: the text is empty, or begins or ends with a blank: write it, or delete the entry")
        if strange := _NOT_IN_XML.search(value):
            raise UserError(f"{path}: the character {strange[0]!r} cannot be written into XML: delete it")
    elif isinstance(value, dict):
        for name, below in value.items():
            _refuse_texts(below, f"{path}.{name}".removeprefix("."))
    elif isinstance(value, list):
        for number, below in enumerate(value):
            _refuse_texts(below, f"{path}[{number}]")


def _faults(found: Details) -> Iterator[str]:
    """What contradicts itself, each with the path of the entry at its beginning."""
    head = found.certificate
    countries = (head.country, found.laboratory.country, found.customer.country)
    for where, code in zip(("certificate", "laboratory", "customer"), countries, strict=True):
        if code and not re.fullmatch("[A-Z]{2}", code):
            yield f"{where}.country: {code!r} is no code by ISO 3166-1: write two capitals, as in 'DE'"
    if head.end < head.begin:
        yield f"certificate.end: {head.end} is before the begin, {head.begin}"
    if head.temperatures_degC is not None and head.temperatures_degC[1] < head.temperatures_degC[0]:
        yield "certificate.temperatures_degC: the highest is below the lowest: write [lowest, highest]"
    if head.temperatures_degC is not None and any(
        not COLDEST_DEGC <= each <= HOTTEST_DEGC for each in head.temperatures_degC
    ):
        yield (
            f"certificate.temperatures_degC: beyond {COLDEST_DEGC} to {HOTTEST_DEGC} degC, in which machines are built "
            "to work (IEC 60204-1): write the temperatures of the place in degrees Celsius"
        )
    if head.issued > datetime.datetime.now(datetime.UTC).date() + datetime.timedelta(days=1):  # of any time zone
        yield f"certificate.issued: {head.issued} lies in the future: write the day of the issue"
    if head.issued < head.end:
        yield f"certificate.issued: {head.issued} is before the end of the measurement, {head.end}"
    for name in ("instrument", "person"):
        if not getattr(found, name):
            yield f"{name} is missing: write a table [[{name}]] into the file"
    for each in found.instrument:
        if each.valid_until is not None and each.valid_until < head.end:
            ended = f"the certificate of {each.name} ended on {each.valid_until}, before {head.end}"
            yield f"instrument.valid_until: {ended}: measure with an instrument whose certificate is valid"
    if head.limits and head.decision_rule is None:
        yield "certificate.decision_rule is missing: limits need 'guard band' or 'simple acceptance'"
