"""The structure of a DCC 3.3.0 with D-SI 2.2, as far as ncomp writes it, by hand.

Written after the published schemas of PTB, dcc.xsd 3.3.0 and SI_Format.xsd 2.2 (LGPL-3.0, gitlab.com/ptb/dcc/xsd-dcc):
no package has them, and they are not copied here; docs/certificate.md says how certificates were validated by them. The
form of `release`, and the conditions that are needed, are rules of dcc.sch in the package dcclib 0.4.0. Of each element:
the children, in order, as a regular expression.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

LONGEST_TEXT = 10_000_000
"""XML_MAX_TEXT_LENGTH of libxml2: a reader that allows no more refuses the file."""
NO_BLANK_ENDS = r"\S+(\s+\S+)*"
DECIMAL = r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?"
LIST = rf"{DECIMAL}( {DECIMAL})*"
DATE = r"\d{4}-\d\d-\d\d"
RICH = "(name )?(content )+"
CONTACT = "name (eMail )?(phone )?(fax )?(link )?location "
DATA = "((text|formula|byteData|xml|quantity|list) )+"
CHILDREN = {
    "digitalCalibrationCertificate": "administrativeData measurementResults (comment )?(document )?(Signature )*",
    "dccSoftware|usedSoftware": "(software )+",
    "software": "name release (type )?(description )?",
    "coreData": "countryCodeISO3166_1 (usedLangCodeISO639_1 )+(mandatoryLangCodeISO639_1 )+uniqueIdentifier "
    "(identifications )?(receiptDate )?beginPerformanceDate endPerformanceDate performanceLocation (issueDate )?",
    "items": "(item )+",
    "item": "name (equipmentClass )*(description )?(owner )?(installedSoftwares )?(manufacturer )?(model )?identifications ",
    "identifications": "(identification )+",
    "identification": "issuer value (name )?",
    "calibrationLaboratory": "(calibrationLaboratoryCode )?contact ",
    "contact|customer": CONTACT,
    "person|manufacturer": CONTACT.replace("location ", "(location )?"),
    "location": "((city|countryCode|postCode|state|street|streetNo) )+",
    "respPersons": "(respPerson )+",
    "respPerson": "person (description )?(role )?(mainSigner )?",
    "statements": "(statement )+",
    "statement": "(name )?(description )?(norm )*(reference )*(declaration )?(conformity )?(data )?",
    "measurementResults": "(usedMethods )?(measurementResult )+",
    "measurementResult": "name (description )?(usedMethods )?(usedSoftware )?(measuringEquipments )?influenceConditions results ",
    "usedMethods": "(usedMethod )+",
    "usedMethod": "name (description )?(norm )*",
    "measuringEquipments": "(measuringEquipment )+",
    "measuringEquipment": "name (description )?(certificate )?(manufacturer )?(model )?(identifications )?",
    "influenceConditions": "(influenceCondition )+",
    "influenceCondition": "name (description )?(status )?data ",
    "results": "(result )+",
    "result": "name (description )?data ",
    "data": DATA,
    "list": "(name )?(description )?((list|quantity) )+",
    "quantity": "(name )?(description )?(real|realListXMLList) ",
    "document": "(name )?(description )?fileName mimeType dataBase64 ",
    "name": "(content )+",
    "description|declaration": RICH,
    "real": "(label )?value unit (measurementUncertaintyUnivariate )?",
    "measurementUncertaintyUnivariate": "expandedMU ",
    "expandedMU": "valueExpandedMU coverageFactor coverageProbability ",
    "realListXMLList": "valueXMLList unitXMLList (measurementUncertaintyUnivariateXMLList )?",
    "measurementUncertaintyUnivariateXMLList": "expandedMUXMLList ",
    "expandedMUXMLList": "valueExpandedMUXMLList coverageFactorXMLList coverageProbabilityXMLList ",
}
ALL = {"dccSoftware", "coreData", "items", "calibrationLaboratory", "respPersons", "customer", "statements"}
"""Children of administrativeData, in any order."""
TEXTS = {
    "countryCodeISO3166_1|countryCode": "[A-Z]{2}",
    "usedLangCodeISO639_1|mandatoryLangCodeISO639_1": "[a-z]{2}",
    "beginPerformanceDate|endPerformanceDate|issueDate": DATE,
    "performanceLocation": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "issuer": "manufacturer|calibrationLaboratory|customer|owner|other",
    "release": r"[a-zA-Z]( )?([0-9]{1,3}\.){0,3}[0-9]{1,3}",
    "conformity": "pass|fail|conditionalPass|conditionalFail|noPass|noFail",
    "mainSigner": "true|false",
    "dataBase64": "[A-Za-z0-9+/]+={0,2}",
    "coverageFactor|coverageFactorXMLList": r"[1-9]\d*(\.\d+)?",
    "coverageProbability|coverageProbabilityXMLList": r"0?\.\d+",
    "valueExpandedMU": DECIMAL.removeprefix("[-+]?"),
    "valueXMLList|valueExpandedMUXMLList": LIST,
    "unit|unitXMLList": r"(\\[a-z]+(\{-?\d+\})?)+",
    "content": r"[\s\S]+",
}
SPACES = ("{https://ptb.de/dcc}", "{https://ptb.de/si}")


def faults(data: bytes) -> list[str]:
    """What does not fit the structure, each with the name of its element."""
    root = ET.fromstring(data)
    found = [] if root.get("schemaVersion") == "3.3.0" else ["schemaVersion"]
    for element in root.iter():
        if not element.tag.startswith(SPACES):
            continue
        name = element.tag.partition("}")[2]
        children = "".join(f"{child.tag.partition('}')[2]} " for child in element)
        text = (element.text or "").strip()
        if name in ("comment", "administrativeData"):
            fits = name == "comment" or set(children.split()) == ALL
        elif name == "value" and element.tag.startswith(SPACES[1]):
            fits = re.fullmatch(DECIMAL, text)
        else:
            models = {key: (model, children) for key, model in CHILDREN.items()} if children else {}
            models |= {} if children else {key: (model, text) for key, model in TEXTS.items()}
            model, own = next((m for key, m in models.items() if name in key.split("|")), (NO_BLANK_ENDS, text))
            fits = re.fullmatch(model, own) and (bool(children) == any(name in key.split("|") for key in CHILDREN))
        fits = fits and len(element.text or "") <= LONGEST_TEXT
        found += [] if fits else [f"{name}: {children or text[:80]}"]
    return found
