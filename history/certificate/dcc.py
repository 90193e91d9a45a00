"""The certificate as a Digital Calibration Certificate of PTB: DCC 3.3.0 with units of D-SI.

All numbers have the digits that give back the same number. The document from which they come is in it as a whole.
"""

from __future__ import annotations

import base64
import gzip
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from history.certificate.conformity import NORMS, RULES, SHOWN, Statement
from history.certificate.details import Contact, Details, Instrument, Item, Person
from history.certificate.results import Curve, Results
from history.entries import Quantity
from kinematics.files.certificate import COMPRESSED, LONGEST, MARK, SPACES, fingerprint_of
from kinematics.user_error import UserError
from kinematics.version import VERSION

SCHEMA = "3.3.0"
"""Version of the schema, https://ptb.de/dcc/v3.3.0/dcc.xsd; the form of `release` and the conditions are PTB's rules
(Schematron) in the package dcclib."""
UNITS = {
    "um": r"\micro\metre", "urad": r"\micro\radian", "um/m": r"\micro\metre\metre\tothe{-1}", "mm": r"\milli\metre",
    "deg": r"\degree", "degC": r"\degreecelsius",
}  # fmt: skip
"""Units of D-SI."""
COVERAGE, PROBABILITY = "2", "0.95"
"""Coverage factor of U, and the probability that it stands for."""
UNCERTAINTY = (
    "The uncertainty is the expanded uncertainty by the GUM with the coverage factor k = 2, which for a normal "
    "distribution covers about 95 %."
)
VALIDITY = "The results refer to the machine named here, in its state at the time of the measurement."


def certificate_xml(details: Details, results: Results, stated: Sequence[Statement]) -> bytes:
    """The certificate."""
    for prefix, space in SPACES.items():
        ET.register_namespace(prefix, space)
    root = node(
        "dcc:digitalCalibrationCertificate", _administrative(details, results, stated), _measured(details, results)
    )
    root.set("schemaVersion", SCHEMA)
    root.set(f"{{{SPACES['xsi']}}}schemaLocation", f"{SPACES['dcc']} {SPACES['dcc']}/v{SCHEMA}/dcc.xsd")
    comment = node("dcc:comment")
    root.extend((comment, _document(results)))
    mark = ET.SubElement(comment, MARK)
    mark.text = fingerprint_of(root)
    ET.indent(root)
    return bytes(ET.tostring(root, "utf-8", xml_declaration=True)) + b"\n"


def node(name: str, *content: ET.Element | str | None, **attributes: str) -> ET.Element:
    """An element, by the prefix and the name, with its text or its children; None is no child."""
    prefix, _, own = name.partition(":")
    made = ET.Element(f"{{{SPACES[prefix]}}}{own}", attributes)
    for each in content:
        if isinstance(each, str):
            made.text = each
        elif each is not None:
            made.append(each)
    return made


def _given(name: str, value: str) -> ET.Element | None:
    return node(name, value) if value else None


def _text(name: str, *texts: str) -> ET.Element:
    return node(name, *(node("dcc:content", each, lang="en") for each in texts))


def _identified(issuer: str, value: str, name: str) -> ET.Element:
    return node("dcc:identification", node("dcc:issuer", issuer), node("dcc:value", value), _text("dcc:name", name))


def _administrative(details: Details, results: Results, stated: Sequence[Statement]) -> ET.Element:
    head, laboratory = details.certificate, details.laboratory
    core = node(
        "dcc:coreData",
        node("dcc:countryCodeISO3166_1", head.country),
        node("dcc:usedLangCodeISO639_1", "en"),
        node("dcc:mandatoryLangCodeISO639_1", "en"),
        node("dcc:uniqueIdentifier", head.identifier),
        node("dcc:beginPerformanceDate", str(head.begin)),
        node("dcc:endPerformanceDate", str(head.end)),
        node("dcc:performanceLocation", head.place),
        node("dcc:issueDate", str(head.issued)),
    )
    people = [_person(each, first=each is details.person[0]) for each in details.person]
    return node(
        "dcc:administrativeData",
        node("dcc:dccSoftware", _software()),
        core,
        node("dcc:items", _item(details.machine)),
        node("dcc:calibrationLaboratory", _given("dcc:calibrationLaboratoryCode", laboratory.code),
             _contact("dcc:contact", laboratory)),
        node("dcc:respPersons", *people),
        _contact("dcc:customer", details.customer),
        node("dcc:statements", *_statements(details, results, stated)),
    )  # fmt: skip


def _software() -> ET.Element:
    return node("dcc:software", _text("dcc:name", "ncomp"), node("dcc:release", f"v{VERSION}"))


def _item(machine: Item) -> ET.Element:
    return node(
        "dcc:item",
        _text("dcc:name", machine.name),
        _maker(machine),
        _given("dcc:model", machine.model),
        node("dcc:identifications", _identified("manufacturer", machine.serial_number, "Serial number")),
    )


def _maker(made: Item | Instrument) -> ET.Element | None:
    return node("dcc:manufacturer", _text("dcc:name", made.manufacturer)) if made.manufacturer else None


def _contact(name: str, contact: Contact) -> ET.Element:
    location = node(
        "dcc:location",
        node("dcc:city", contact.city),
        _given("dcc:countryCode", contact.country),
        _given("dcc:postCode", contact.post_code),
        _given("dcc:street", contact.street),
    )
    ways = _given("dcc:eMail", contact.email), _given("dcc:phone", contact.phone)
    return node(name, _text("dcc:name", contact.name), *ways, location)


def _person(person: Person, *, first: bool) -> ET.Element:
    named = node("dcc:person", _text("dcc:name", person.name), _given("dcc:eMail", person.email))
    signer = node("dcc:mainSigner", "true") if first else None
    return node("dcc:respPerson", named, _given("dcc:role", person.role), signer)


def _statements(details: Details, results: Results, stated: Sequence[Statement]) -> Iterator[ET.Element]:
    for text in filter(None, (VALIDITY, details.certificate.remarks, *results.remarks)):
        yield node("dcc:statement", _text("dcc:declaration", text))
    for each in stated:
        yield node(
            "dcc:statement",
            _text("dcc:name", each.figure.name),
            *(node("dcc:norm", norm) for norm in NORMS[each.rule]),
            _text("dcc:declaration", f"{each.figure.name}: {SHOWN[each.outcome]}. {RULES[each.rule]}"),
            node("dcc:conformity", each.outcome),
            node("dcc:data", node("dcc:quantity", _text("dcc:name", "Limit"), _real(each.limit, each.figure.unit))),
            refType="basic_conformity",
        )


def _measured(details: Details, results: Results) -> ET.Element:
    """The measurement: methods, equipment, conditions, results."""
    methods = node(
        "dcc:usedMethods",
        node("dcc:usedMethod", _text("dcc:name", results.title), *(node("dcc:norm", norm) for norm in results.norms)),
        node("dcc:usedMethod", _text("dcc:name", "Uncertainty"), _text("dcc:description", UNCERTAINTY),
             node("dcc:norm", "JCGM 100:2008"), refType="basic_uncertainty"),
    )  # fmt: skip
    equipment = node("dcc:measuringEquipments", *map(_equipment, details.instrument))
    conditions = [_temperature(name, *ends) for name, ends in results.temperatures.items()]
    lists = [_result("Results", *map(_quantity, results.figures))]
    lists += [_result(curve.name, _curve(curve)) for curve in results.curves]
    return node(
        "dcc:measurementResults",
        node(
            "dcc:measurementResult",
            _text("dcc:name", results.title),
            methods,
            node("dcc:usedSoftware", _software()),
            equipment,
            node("dcc:influenceConditions", *conditions),
            node("dcc:results", *lists),
        ),
    )


def _equipment(instrument: Instrument) -> ET.Element:
    numbers = node(
        "dcc:identifications",
        _identified("manufacturer", instrument.number, "Serial number"),
        _identified("other", instrument.certificate, "Number of its calibration certificate"),
    )
    name = _text("dcc:name", instrument.name)
    return node("dcc:measuringEquipment", name, _maker(instrument), _given("dcc:model", instrument.model), numbers)


def _temperature(sensor: str, low: float, high: float) -> ET.Element:
    quantities = [
        node("dcc:quantity", _text("dcc:name", name), _real(value, "degC"))
        for name, value in {"lowest": low, "highest": high}.items()
    ]
    name = _text("dcc:name", f"Temperature, {sensor}")
    return node("dcc:influenceCondition", name, node("dcc:data", *quantities), refType="basic_temperature")


def _result(name: str, *data: ET.Element) -> ET.Element:
    return node("dcc:result", _text("dcc:name", name), node("dcc:data", *data))


def _quantity(figure: Quantity) -> ET.Element:
    return node("dcc:quantity", _text("dcc:name", figure.name), _real(figure.value, figure.unit, 2.0 * figure.u))


def _real(value: float, unit: str, U: float | None = None) -> ET.Element:
    """A number, with its expanded uncertainty where it has one."""
    uncertainty = None
    if U is not None:
        uncertainty = node("si:measurementUncertaintyUnivariate", node("si:expandedMU", *_coverage("", repr(U))))
    return node("si:real", node("si:value", repr(float(value))), node("si:unit", _unit(unit)), uncertainty)


def _unit(unit: str) -> str:
    if unit not in UNITS:
        raise UserError(f"{unit!r} is no unit of a certificate, which are {', '.join(UNITS)}: evaluate the data again")
    return UNITS[unit]


def _coverage(form: str, U: str) -> Iterator[ET.Element]:
    """Expanded uncertainties with their coverage; form: `XMLList` for lists."""
    yield node(f"si:valueExpandedMU{form}", U)
    yield node(f"si:coverageFactor{form}", COVERAGE)
    yield node(f"si:coverageProbability{form}", PROBABILITY)


def _curve(curve: Curve) -> ET.Element:
    """A list of the positions and one of the values."""
    at = node("dcc:quantity", _text("dcc:name", "Position"), _list(curve.positions, curve.position_unit))
    values = node("dcc:quantity", _text("dcc:name", curve.name), _list(curve.values, curve.unit, curve.U))
    return node("dcc:list", at, values)


def _list(values: Sequence[float], unit: str, U: Sequence[float] = ()) -> ET.Element:
    """Numbers of one unit, with their expanded uncertainties where there are some."""
    uncertainty = None
    if U:
        expanded = node("si:expandedMUXMLList", *_coverage("XMLList", _numbers(U)))
        uncertainty = node("si:measurementUncertaintyUnivariateXMLList", expanded)
    units = node("si:unitXMLList", _unit(unit))
    return node("si:realListXMLList", node("si:valueXMLList", _numbers(values)), units, uncertainty)


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(each)) for each in values)


def _document(results: Results) -> ET.Element:
    """The calibration or the results as a whole, compressed where this is too long for readers of XML."""
    text, name, kind = _base64(results.document), "_".join(results.name.split()), "application/json"
    if len(text) > LONGEST:
        text, name, kind = _base64(gzip.compress(results.document, 6, mtime=0)), f"{name}.gz", COMPRESSED
    if len(text) > LONGEST:
        raise UserError(
            f"{results.name}: it is too large for a certificate: compressed it has {len(text) / 1e6:.0f} million "
            f"characters, and readers of XML take {LONGEST / 1e6:.0f} million in one text: fit fewer parameters"
        )
    return node(
        "dcc:document",
        _text("dcc:description", "The result for programs, with the covariance of a calibration; ncomp reads it."),
        node("dcc:fileName", name),
        node("dcc:mimeType", kind),
        node("dcc:dataBase64", text),
    )


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
