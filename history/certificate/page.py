"""The certificate as a page to sign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from history.certificate.conformity import NORMS, RULES, SHOWN, Statement
from history.certificate.dcc import UNCERTAINTY, VALIDITY
from history.certificate.details import Contact, Details
from history.certificate.results import Curve, Results, largest
from kinematics.files import fingerprint
from kinematics.files.number_text import plus_minus
from kinematics.files.report_head import ReportHead
from rendering.report import Report, Section, Table, facts

VALUES = ("result", "value and U (k=2)", "unit")
STATED = ("result", "value and U (k=2)", "limit", "unit", "statement")
CURVES = ("error motion", "unit", "largest value and U (k=2)", "at")
INSTRUMENTS = ("instrument", "number", "calibration certificate", "valid until")


def certificate_report(details: Details, results: Results, stated: Sequence[Statement]) -> Report:
    """The page; what it says is what the DCC says."""
    head, machine = details.certificate, details.machine
    own = ReportHead(
        company=details.laboratory.name, machine=machine.name, serial_number=machine.serial_number,
        temperature=", ".join(f"{low:g} to {high:g} °C" for low, high in results.temperatures.values()),
        operator=details.person[0].name, place=details.customer.city,
        instrument=", ".join(each.name for each in details.instrument),
        instrument_number=", ".join(each.number for each in details.instrument), measured=f"{head.begin} to {head.end}",
    )  # fmt: skip
    sections = [*_people(details), *_results(details, results, stated)]
    lead = f"{results.title} · {head.identifier}"
    title = f"Calibration certificate {head.identifier}"
    return Report(
        title,
        lead,
        sections,
        _verdict(results, stated),
        head=own,
        foot=f"{title} · {results.name} {fingerprint(results.document)}",
    )


def _verdict(results: Results, stated: Sequence[Statement]) -> str:
    lines = [f"{each.figure.name}: {SHOWN[each.outcome]}." for each in stated]
    lines = lines or [f"{len(results.figures)} results, without a statement of conformity."]
    return "\n".join([*lines, *results.remarks])


def _people(details: Details) -> Iterator[Section]:
    head, machine = details.certificate, details.machine
    named = " ".join(filter(None, (machine.manufacturer, machine.model, machine.name)))
    rows = [
        ("identifier", head.identifier),
        ("laboratory", _address(details.laboratory)),
        ("customer", _address(details.customer)),
        ("machine", f"{named}, serial number {machine.serial_number}"),
        ("measured", f"{head.begin} to {head.end}"),
        ("issued", str(head.issued)),
        *((each.role or "responsible", each.name) for each in details.person),
    ]
    yield facts("Certificate", rows)
    used = [(each.name, each.number, each.certificate, str(each.valid_until or "")) for each in details.instrument]
    yield Section("Measuring equipment", table=Table(INSTRUMENTS, used))


def _address(contact: Contact) -> str:
    town = " ".join(filter(None, (contact.country, contact.post_code, contact.city)))
    return ", ".join(filter(None, (contact.name, contact.street, town, contact.code)))


def _results(details: Details, results: Results, stated: Sequence[Statement]) -> Iterator[Section]:
    values = [(each.name, plus_minus(each.value, 2.0 * each.u, 2), each.unit) for each in results.figures]
    yield Section("Results", f"Methods: {', '.join(results.norms)}. {UNCERTAINTY}", Table(VALUES, values))
    if rule := details.certificate.decision_rule:
        rows = [
            (name, plus_minus(value, 2.0 * u, 2), f"{each.limit:g}", unit, SHOWN[each.outcome])
            for each in stated
            for name, unit, value, u in (each.figure,)
        ]
        yield Section("Conformity", f"{RULES[rule]} ({'; '.join(NORMS[rule])})", Table(STATED, rows))
    yield Section("Along the axes", table=Table(CURVES, list(map(_curve, results.curves))))
    ranges = results.temperatures.items()
    yield facts("Conditions", [(f"temperature, {name}", f"{low:.1f} to {high:.1f} °C") for name, (low, high) in ranges])
    notes = (VALIDITY, details.certificate.remarks)
    yield Section("Statements", "\n".join(filter(None, notes)))


def _curve(curve: Curve) -> tuple[str, str, str, str]:
    i = largest(curve)
    U = curve.U[i] if curve.U else 0.0
    return curve.name, curve.unit, plus_minus(curve.values[i], U, 2), f"{curve.positions[i]:g} {curve.position_unit}"
