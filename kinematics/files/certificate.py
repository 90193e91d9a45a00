"""The document of ncomp in a Digital Calibration Certificate (DCC of PTB), and the fingerprint of the certificate.

The fingerprint is the SHA-256 of all that the certificate says, in canonical form (C14N 2.0): another layout or other
prefixes of the namespaces do not change it, and a signature may be added. It shows a change; it is no signature.
"""

from __future__ import annotations

import base64
import datetime
import hashlib
import xml.etree.ElementTree as ET
import zlib
from typing import NamedTuple

from kinematics.user_error import UserError

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si", "xsi": "http://www.w3.org/2001/XMLSchema-instance"}
"""Namespaces by their prefixes."""
ROOT = f"{{{SPACES['dcc']}}}digitalCalibrationCertificate"
SAID = ("dcc:administrativeData", "dcc:measurementResults", "dcc:document")
"""The parts that the fingerprint counts."""
MARK = "sha256"
"""Name of the element in the comment that has the fingerprint."""
MOST_CERTIFICATE_BYTES = 64 * 2**20
"""Size of a certificate, bytes, that is still read: about ten times that of a calibration with 600 parameters."""
LONGEST = 10_000_000
"""Characters in one text of a certificate: what libxml2 reads by default, and lxml and PTB's dcclib with it."""
COMPRESSED = "application/gzip"
"""Type of a document that is compressed, because it would be a longer text otherwise."""


class Carried(NamedTuple):
    """What a certificate carries."""

    document: bytes
    """A calibration, or results of `ncomp iso230`, as they were given to the laboratory's command."""
    identifier: str
    ended: datetime.date
    """Last day of the measurement."""
    equipment: str
    """Instruments and their numbers."""


def fingerprint_of(root: ET.Element) -> str:
    """SHA-256 of the parts of a certificate in canonical form."""
    parts = (ET.tostring(part, "unicode") for name in SAID if (part := root.find(name, SPACES)) is not None)
    canonical = "".join(ET.canonicalize(part, strip_text=True, rewrite_prefixes=True) for part in parts)
    return hashlib.sha256(canonical.encode()).hexdigest()


def carried(data: bytes, source: str) -> Carried:
    """What the certificate of this name carries; UserError for one that ncomp has not written, or that was edited."""
    where = f"certificate {source}"
    root = _root(data, where)
    foreign = UserError(f"{where}: it carries no result of ncomp: give one that 'ncomp certificate' has written")
    mark = root.findtext(f"dcc:comment/{MARK}", namespaces=SPACES)
    if mark is None:
        raise foreign
    try:
        edited = mark.strip() != fingerprint_of(root)
    except RecursionError:
        raise foreign from None
    if edited:
        raise UserError(
            f"{where}: it was edited after it was made, because its content does not fit its fingerprint: ask the "
            "laboratory for the certificate as it was issued"
        )
    core = "dcc:administrativeData/dcc:coreData"
    equipment = [
        " ".join(filter(None, (each.findtext(path, namespaces=SPACES) for path in _NAME_AND_NUMBER)))
        for each in root.iterfind(".//dcc:measuringEquipment", SPACES)
    ]
    try:
        document = _document(root)
        ended = datetime.date.fromisoformat(root.findtext(f"{core}/dcc:endPerformanceDate", "", SPACES))
    except (ValueError, zlib.error):
        raise foreign from None
    return Carried(document, root.findtext(f"{core}/dcc:uniqueIdentifier", "", SPACES), ended, ", ".join(equipment))


def _document(root: ET.Element) -> bytes:
    """The document of a certificate; ValueError or zlib.error for a damaged one, and for one that expands too far."""
    content = base64.b64decode(root.findtext("dcc:document/dcc:dataBase64", "", SPACES))
    if root.findtext("dcc:document/dcc:mimeType", "", SPACES) != COMPRESSED:
        return content
    reader = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)  # 16: with the header of gzip
    content = reader.decompress(content, MOST_CERTIFICATE_BYTES)
    if not reader.eof:
        raise ValueError("the document is cut, or larger than what is read")
    return content


_NAME_AND_NUMBER = ("dcc:name/dcc:content", "dcc:identifications/dcc:identification/dcc:value")


class _WithoutEntities(ET.TreeBuilder):
    """Builds a tree of XML that declares nothing: neither entities nor files elsewhere."""

    def doctype(self, *_: object) -> None:
        """Refuse a document type, before any entity in it is read."""
        raise UserError("it has a document type (<!DOCTYPE>), which no certificate needs: give the file as issued")


def _root(data: bytes, where: str) -> ET.Element:
    """The root of a certificate; UserError for another file."""
    if len(data) > MOST_CERTIFICATE_BYTES:
        raise UserError(
            f"{where}: it has {len(data) / 2**20:.0f} MB, and at most {MOST_CERTIFICATE_BYTES // 2**20} MB are read"
        )
    try:
        root = ET.fromstring(data, ET.XMLParser(target=_WithoutEntities()))
    except UserError as fault:
        raise UserError(f"{where}: {fault}") from None
    except (ET.ParseError, ValueError, LookupError) as fault:
        line = f":{fault.position[0]}" if isinstance(fault, ET.ParseError) else ""
        raise UserError(f"{where}{line}: the file is cut or damaged ({fault}): ask for it again") from None
    if root.tag != ROOT:
        raise UserError(f"{where}: this is no Digital Calibration Certificate: its root is {root.tag}")
    return root
