"""`ncomp certificate`: the DCC and the page, what is refused, and the way back into compare and the history."""

from __future__ import annotations

import base64
import gzip
import json
import random
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import msgspec
import pytest
from support.command import refusal, succeed
from support.dcc_structure import faults
from support.history_cases import calibration, entries

from history.certificate.conformity import Statement
from history.entries import Quantity
from kinematics.files.certificate import MOST_CERTIFICATE_BYTES, SPACES, fingerprint_of

DETAILS = """\
[certificate]
identifier = "KB-2026-0417"
country = "DE"
begin = 2026-03-01
end = 2026-03-02
issued = 2026-03-05
temperatures_degC = [19.5, 21.0]
limits = ["squareness X-Y=0.0078mm/300mm"]
decision_rule = "guard band"

[laboratory]
name = "Miller & Söhne <Messtechnik>"
city = "Aachen"
street = "Werkstraße 1"
code = "D-K-15151-01-00"

[customer]
name = "Smith Tools"
city = "Bremen"
country = "DE"

[machine]
name = "cframe"
serial_number = "4711"
manufacturer = "Deckel"

[[instrument]]
name = "laser tracker"
number = "390112"
certificate = "PTB-5.2-2025-11"
valid_until = 2026-11-30

[[person]]
name = "A. Miller"
role = "head of the laboratory"
"""


@pytest.fixture
def cal(tmp_path: Path, command: None) -> Path:  # noqa: ARG001
    """A calibration with a squareness X-Y of 20 um/m, U 4 um/m, and the details beside it."""
    (tmp_path / "details.toml").write_text(DETAILS)
    return calibration(tmp_path / "cal.json", 20.0)


def certified(result: Path, *words: object) -> Path:
    """The certificate of a result."""
    written = result.with_suffix(".xml")
    succeed("certificate", result, "--details", result.with_name("details.toml"), "-o", written, *words)
    return written


def refused(result: Path, change: tuple[str, str] = ("", "")) -> str:
    """The refusal of a certificate with a change of the details; nothing is written."""
    details = result.with_name("details.toml")
    assert change[0] in DETAILS
    details.write_text(DETAILS.replace(*change) if change[0] else DETAILS)
    written = result.with_name("refused.xml")
    message = refusal("certificate", result, "--details", details, "-o", written)
    assert not written.exists()
    return message


def quantities(certificate: Path) -> dict[str, tuple[float, str, float]]:
    """Value, unit and U of the results in a certificate, by another reader."""
    root = ET.parse(certificate).getroot()
    found = {}
    for each in root.iterfind(".//dcc:result[1]/dcc:data/dcc:quantity", SPACES):
        texts = [each.findtext(path, "", SPACES) for path in ("dcc:name/dcc:content", ".//si:value", ".//si:unit")]
        found[texts[0]] = float(texts[1]), texts[2], float(each.findtext(".//si:valueExpandedMU", "", SPACES))
    return found


@pytest.fixture
def laser(tmp_path: Path, command: None) -> Path:  # noqa: ARG001
    """Results of ISO 230-2."""
    (tmp_path / "details.toml").write_text(DETAILS.replace("squareness X-Y=0.0078mm/300mm", "A X=0.1mm"))
    made = ("--machine", "cframe", "--strategy", "axes", "--spacing", "90", "--runs", "5", "--seed", "3")
    succeed("simulate", *made, "--instrument", "interferometer", "-o", tmp_path / "laser.csv")
    succeed("iso230", tmp_path / "laser.csv", "--machine", "cframe", "--json", tmp_path / "laser.json")
    return tmp_path / "laser.json"


def test_the_numbers_of_a_calibration_are_those_of_compare_and_carry_it_whole(cal):
    dcc = certified(cal)
    assert faults(dcc.read_bytes()) == []
    value, unit, U = quantities(dcc)["squareness X-Y"]
    assert (round(value, 9), unit, U) == (20.0, r"\micro\metre\metre\tothe{-1}", 4.0)
    same = json.loads(succeed("compare", cal, dcc, "--json", "-").out)
    assert same["a"]["id"] == same["b"]["id"]
    assert same["volume"]["difference_um"]["max"] == 0.0
    other = calibration(cal.with_name("other.json"), 31.0)
    through, direct = (json.loads(succeed("compare", each, other, "--json", "-").out) for each in (dcc, cal))
    for answer in (through, direct):
        del answer["a"], answer["provenance"]
    assert through == direct


def test_a_certificate_is_a_calibration_wherever_one_is_read(cal, tmp_path):
    (tmp_path / "part.nc").write_text("G21 G90 G54\nG0 X0 Y0 Z0\nG1 X300 Y200 F500\nM30\n")
    for each in (cal, certified(cal)):
        words = ("--machine", "cframe", "--calibration", each, "--set-up-zero", "-o", tmp_path / f"{each.suffix}.nc")
        succeed(tmp_path / "part.nc", *words)
    assert (tmp_path / ".xml.nc").read_bytes() == (tmp_path / ".json.nc").read_bytes()


def test_the_history_enters_what_a_certificate_carries_on_its_date(cal, laser, tmp_path):
    dcc, positioning = certified(laser), laser.with_suffix(".xml")
    (tmp_path / "details.toml").write_text(DETAILS)
    dcc = certified(cal)
    db = tmp_path / "life.sqlite"
    succeed("history", "add", "cframe", dcc, positioning, "--db", db)
    direct = tmp_path / "direct.sqlite"
    succeed("history", "add", "cframe", cal, laser, "--at", "2026-03-02", "--db", direct)
    kept, wanted = entries(str(db)), entries(str(direct))
    assert [each["kind"] for each in kept] == ["calibration", "iso230-2"]
    assert [each["figures"] for each in kept] == [each["figures"] for each in wanted]
    assert {each["at"][:10] for each in kept} <= {"2026-03-01", "2026-03-02"}
    assert {each["method"] for each in kept} == {"laser tracker 390112"}
    assert "is of machine 'cframe'" in refusal("history", "add", "gantry", positioning, "--db", db)
    assert "of machine cframe" in refusal("history", "add", "gantry", dcc, "--db", db)


def test_positioning_is_certified_with_its_uncertainty(laser):
    dcc = certified(laser)
    assert faults(dcc.read_bytes()) == []
    axes = json.loads(laser.read_text())["axes"]
    values = {each["axis"]: each["values"] for each in axes}
    found = quantities(dcc)
    assert found["A X"] == (values["X"]["A"]["value_um"], r"\micro\metre", values["X"]["A"]["U_um"])
    root = ET.parse(dcc).getroot()
    means = root.findtext(".//dcc:result[2]//dcc:quantity[2]//si:valueXMLList", "", SPACES).split()
    assert list(map(float, means)) == [each["forward"]["mean_um"] for each in axes[0]["targets"]]
    statements = [each.text for each in root.iterfind(".//dcc:declaration/dcc:content", SPACES)]
    warning = "X: the data are simulated, and describe no real machine"
    assert warning in statements
    words = ("--details", laser.with_name("details.toml"), "-o", dcc, "--quiet")
    assert warning in succeed("certificate", laser, *words).shown, "also the verdict, at the head of the page"


@pytest.mark.parametrize(
    ("limit", "guard_band", "simple"),
    [
        (24.0, "pass", "pass"),  # 20 + 4
        (23.9, "conditionalPass", "pass"),
        (20.0, "conditionalPass", "pass"),
        (19.9, "conditionalFail", "fail"),
        (16.0, "conditionalFail", "fail"),  # 20 - 4
        (15.9, "fail", "fail"),
    ],
)
def test_the_statement_follows_the_decision_rule(limit, guard_band, simple):
    figure = Quantity("squareness X-Y", "um/m", -20.0, 2.0)
    assert Statement(figure, limit, "guard band").outcome == guard_band
    assert Statement(figure, limit, "simple acceptance").outcome == simple


def test_the_page_says_who_what_with_what_and_by_which_rule(cal, tmp_path):
    certified(cal, "--report", tmp_path / "page.html", "--json", tmp_path / "answer.json")
    page = (tmp_path / "page.html").read_text()
    for text in (
        "KB-2026-0417", "Miller &amp; Söhne &lt;Messtechnik&gt;", "D-K-15151-01-00", "Smith Tools", "4711", "390112",
        "PTB-5.2-2025-11", "A. Miller", "2026-03-05", "20.00 ± 4.00", "Decision rule: guard band", "squareness X-Y: conforms",
    ):  # fmt: skip
        assert text in page, text
    stated = json.loads((tmp_path / "answer.json").read_text())["conformity"]
    assert [(each["name"], round(each["limit"], 9), each["statement"]) for each in stated] == [
        ("squareness X-Y", 26.0, "pass")
    ]


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('country = "DE"\nbegin', "begin", "certificate.country is missing"),
        ('number = "390112"\n', "", "instrument[0].number is missing"),
        ('certificate = "PTB-5.2-2025-11"', 'certificat = "1"', "did you mean 'certificate'"),
        ('serial_number = "4711"\n', "", "machine.serial_number is missing"),
        ('serial_number = "4711"', 'serial_number = " "', "machine.serial_number: the text is empty"),
        ('"Smith Tools"', '"a\\u0001b"', "cannot be written into XML"),
        ('country = "DE"\nbegin', 'country = "Germany"\nbegin', "no code by ISO 3166-1"),
        ("end = 2026-03-02", "end = 2026-02-28", "certificate.end: 2026-02-28 is before the begin"),
        ("issued = 2026-03-05", "issued = 2026-03-01", "certificate.issued: 2026-03-01 is before the end"),
        ("valid_until = 2026-11-30", "valid_until = 2026-03-01", "ended on 2026-03-01"),
        ("temperatures_degC = [19.5, 21.0]\n", "", "certificate.temperatures_degC is missing"),
        ("[19.5, 21.0]", "[21.0, 19.5]", "the highest is below the lowest"),
        ("[19.5, 21.0]", "[68, 70]", "certificate.temperatures_degC: beyond 5 to 40 degC"),
        ("[19.5, 21.0]", "[4.9, 21.0]", "write the temperatures of the place in degrees Celsius"),
        ("issued = 2026-03-05", "issued = 2999-03-05", "certificate.issued: 2999-03-05 lies in the future"),
        ("begin = 2026-03-01", "begin = 2026-03-02", "was measured on 2026-03-01, not from 2026-03-02"),
        ('decision_rule = "guard band"\n', "", "certificate.decision_rule is missing"),
        ('"guard band"', '"shared risk"', "'guard band' or 'simple acceptance'"),
        ("squareness X-Y=", "squarenes X-Y=", "did you mean 'squareness X-Y'"),
        ("0.0078mm/300mm", "0.0078mm", "is an angle: state the length of the part"),
        ('name = "cframe"', 'name = "gantry"', "machine.name is 'gantry', and"),
        ('[[person]]\nname = "A. Miller"\nrole = "head of the laboratory"\n', "", "person is missing"),
    ],
)  # fmt: skip
def test_details_that_are_missing_or_contradict_themselves_are_refused(cal, old, new, reason):
    assert reason in refused(cal, (old, new))


def test_results_that_no_certificate_can_state_are_refused(cal, laser, tmp_path):
    bare = json.loads(cal.read_text())
    bare["effects"][0]["u"] = []
    (tmp_path / "bare.json").write_text(json.dumps(bare))
    assert "the uncertainty of" in refused(tmp_path / "bare.json")
    assert "worse than none" in refused(calibration(tmp_path / "weak.json", 1.0))
    drift = {"kind": "location-jump", "component": "X", "axis": "X", "value": 20.0, "u": [2.0], "since_touch_off": True}
    (tmp_path / "now.json").write_text(json.dumps({**bare, "effects": [drift]}))
    assert "certify the calibration without the drift" in refused(tmp_path / "now.json")
    answer = json.loads(laser.read_text())
    answer["axes"][0]["values"]["A"]["U_um"] = 0.0
    laser.write_text(json.dumps(answer))
    assert "the uncertainty of A X is missing" in refused(laser)
    own = {
        "provenance": {"machine": "cframe"},
        "axes": [
            {
                "axis": "X",
                "values": {"A": {"value_in": 1.0, "U_in": 1.0}},
                "targets": [{"position_mm": 0.0, "forward": {"runs": 0}, "backward": {"runs": 0}}],
                "notes": [],
                "astray": [],
            }
        ],
    }
    for content, reason in (
        ({"before": 1}, "neither a calibration nor results"),
        ({**own, "axes": [{**own["axes"][0], "targets": []}]}, "neither a calibration nor results"),
        ({**own, "axes": [{**own["axes"][0], "values": [1]}]}, "neither a calibration nor results"),
        (own, "'in' is no unit of a certificate"),
    ):  # fmt: skip
        (tmp_path / "other.json").write_text(json.dumps(content))
        assert reason in refused(tmp_path / "other.json", ('limits = ["squareness X-Y=0.0078mm/300mm"]\n', "")), content


def test_an_edited_certificate_is_refused_and_another_layout_is_not(cal, tmp_path):
    dcc = certified(cal)
    text = dcc.read_text()
    edited = tmp_path / "edited.xml"
    for old, new in {
        "4.0</si:valueExpandedMU>": "3.0</si:valueExpandedMU>",
        "A. Miller": "B. Miller",
        "2026-03-05": "2026-03-06",
    }.items():
        assert old in text
        edited.write_text(text.replace(old, new, 1))
        assert "it was edited after it was made" in refusal("compare", cal, edited)
        assert "it was edited after it was made" in refusal("history", "add", "cframe", edited)
    for same in (
        re.sub(r">\s+<", "><", text),
        text.replace("dcc:", "d:").replace("xmlns:dcc", "xmlns:d"),
        text.replace("</dcc:digital", '<ds:Signature xmlns:ds="http://www.w3.org/2000/09/xmldsig#"/></dcc:digital'),
    ):
        edited.write_text(same)
        succeed("compare", cal, edited)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ('<!DOCTYPE a [<!ENTITY b "c">]><dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc">&b;</dcc:digitalCalibrationCertificate>', "document type"),
        ('<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc"><a>', ":1: the file is cut or damaged"),
        ('<digitalCalibrationCertificate/>', "no Digital Calibration Certificate"),
        ('<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc"/>', "carries no result of ncomp"),
        ('<?xml version="1.0" encoding="klingon"?><digitalCalibrationCertificate/>', "cut or damaged"),
        ("<digitalCalibrationCertificate>" + " " * MOST_CERTIFICATE_BYTES + "</digitalCalibrationCertificate>", "at most 64 MB are read"),
        ('<?xml version="1.0"?><svg/>', "this is an XML file, no calibration"),
    ],
    ids=["entities", "cut", "namespace", "foreign", "encoding", "size", "other"],
)  # fmt: skip
def test_files_that_are_no_certificate_of_ncomp_are_refused(cal, tmp_path, content, reason):
    (tmp_path / "strange.xml").write_text(content)
    assert reason in refusal("compare", cal, tmp_path / "strange.xml")


@pytest.mark.parametrize(
    "parts",
    [
        "<dcc:document><dcc:dataBase64>?</dcc:dataBase64></dcc:document>",
        "<dcc:administrativeData>" + "<a>" * 3000 + "</a>" * 3000 + "</dcc:administrativeData>",
    ],
    ids=["damaged content", "deeply nested"],
)
def test_a_fingerprint_that_fits_does_not_make_a_certificate(cal, tmp_path, parts):
    head, tail = (
        '<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc">',
        "</dcc:digitalCalibrationCertificate>",
    )
    try:
        mark = fingerprint_of(ET.fromstring(head + parts + tail))
    except RecursionError:
        mark = "unknown"
    comment = f"<dcc:comment><sha256>{mark}</sha256></dcc:comment>"
    (tmp_path / "forged.xml").write_text(head + parts + comment + tail)
    assert "carries no result of ncomp" in refusal("compare", cal, tmp_path / "forged.xml")


def test_the_checked_structure_notices_what_the_schema_forbids(cal):
    data = certified(cal).read_bytes()
    for old, new in {
        b"dcc:issueDate": b"dcc:date",
        rb"\micro\metre": b"um",
        b">DE<": b">D<",
        b"2026-03-02": b"2",
    }.items():
        assert old in data
        assert faults(data.replace(old, new)) != [], old


def test_a_large_calibration_is_carried_in_a_text_that_readers_of_xml_take(cal):
    content = cal.read_bytes() + b" " * 8_000_000
    cal.write_bytes(content)
    dcc = certified(cal)
    assert faults(dcc.read_bytes()) == []
    root = ET.parse(dcc).getroot()
    assert root.findtext("dcc:document/dcc:fileName", "", SPACES) == "cal.json.gz"
    assert gzip.decompress(base64.b64decode(root.findtext("dcc:document/dcc:dataBase64", "", SPACES))) == content
    same = json.loads(succeed("compare", cal, dcc, "--json", "-").out)
    assert same["a"]["id"] == same["b"]["id"]
    assert same["volume"]["difference_um"]["max"] == 0.0


def test_a_calibration_that_is_too_large_for_readers_of_xml_has_no_certificate(cal):
    answer = json.loads(cal.read_text())
    answer["provenance"]["source"] = base64.b64encode(random.Random(0).randbytes(8_000_000)).decode()
    cal.write_text(json.dumps(answer))
    assert "too large for a certificate" in refused(cal)


def test_a_document_that_expands_without_end_is_no_result(cal):
    def with_document(content: bytes) -> str:
        root = ET.parse(certified(cal)).getroot()
        root.find("dcc:document/dcc:mimeType", SPACES).text = "application/gzip"
        root.find("dcc:document/dcc:dataBase64", SPACES).text = base64.b64encode(content).decode()
        root.find("dcc:comment/sha256", SPACES).text = fingerprint_of(root)
        (forged := cal.with_name("forged.xml")).write_bytes(ET.tostring(root))
        return refusal("compare", cal, forged)

    whole = gzip.compress(cal.read_bytes())
    for content in (gzip.compress(b" " * (MOST_CERTIFICATE_BYTES + 1), 1), whole[:-9], b"no gzip"):
        assert "carries no result of ncomp" in with_document(content)


def test_a_second_reader_of_json_finds_the_calibration_in_the_certificate(cal):
    content = ET.parse(certified(cal)).getroot().findtext("dcc:document/dcc:dataBase64", "", SPACES)
    assert base64.b64decode(content) == cal.read_bytes()
    assert msgspec.json.decode(base64.b64decode(content))["machine"]["name"] == "cframe"
