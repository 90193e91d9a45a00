"""Circles of a ballbar by angle and deviation; protocols of controls and ballbar files that are recognised and refused."""

from pathlib import Path

import numpy as np
import pytest
from support.ballbar_cases import CFRAME, circles_of

from calibration.circles.circles import circles_of as read_circles
from calibration.circles.shares import shares
from calibration.measurement.readers import read_any
from kinematics.effects import Backlash, LocationError
from kinematics.user_error import UserError

HEAD = (
    "# machine: cframe\n# u_um: 0.3\n# length_mm: 150\n# centre: 300 225 150\n# target.t1: 0 0 -120\n# plane: XY\n"
    "# feed: 1000\n"
)
ROWS = "angle_deg,deviation_um,run\n0,1.5,a\n10,1.0,a\n20,-0.5,a\n"


@pytest.fixture
def write(tmp_path):
    def writing(text, name="data.csv"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return writing


def by_angle(measured, columns=("angle_deg", "deviation_um", "run", "feed", "plane", "direction")):
    """The text of circles as ballbar software shows them."""
    rows = {}
    for circle in read_circles(measured):
        for row, angle in zip(circle.rows.tolist(), np.degrees(circle.angles).tolist(), strict=True):
            deviation = (measured.observed[row, 0] - 150.0) * 1e3
            rows[row] = {
                "angle_deg": f"{angle:.6f}", "deviation_um": f"{deviation:.4f}", "run": circle.run,
                "radius_mm": f"{measured.observed[row, 0]:.7f}", "feed": f"{circle.feed:g}", "plane": circle.plane,
                "direction": "ccw" if circle.counter_clockwise else "cw",
            }  # fmt: skip
    lines = [",".join(rows[row][name] for name in columns) for row in sorted(rows)]
    header = "".join(line + "\n" for line in HEAD.splitlines() if "plane" not in line and "feed" not in line)
    return header + "\n".join([",".join(columns), *lines, ""])


@pytest.mark.parametrize("planes", [("XY",), ("YZ", "ZX")])
def test_angles_give_the_positions_and_causes_of_the_circles(write, planes):
    measured, _ = circles_of(Backlash("X", 8.0), LocationError("C", "Y", 30.0), step=3.0, planes=planes, seed=4)
    read = read_any(write(by_angle(measured)), CFRAME)
    assert read.run.tolist() == measured.run.tolist()
    np.testing.assert_allclose(read.state.positions, measured.state.positions, atol=0.05)
    np.testing.assert_allclose(read.observed, measured.observed, atol=1e-6)
    own, again = (shares(each, read_circles(each)) for each in (measured, read))
    assert [cause.name for cause in own.causes] == [cause.name for cause in again.causes]
    assert "nominal circle" in read.notes[0]


def test_distances_in_place_of_deviations(write):
    measured, _ = circles_of(step=6.0, seed=1)
    columns = ("angle_deg", "radius_mm", "run", "feed", "plane")
    one, other = (
        read_any(write(by_angle(measured, each)), CFRAME)
        for each in (columns, (*columns[:1], "deviation_um", *columns[2:]))
    )
    np.testing.assert_allclose(one.observed, other.observed, atol=1e-6)


@pytest.mark.parametrize(
    ("head", "rows", "reason"),
    [
        (HEAD, ROWS.replace("run\n0", "run,colour\n0").replace(",a\n", ",a,1\n"), "data.csv:8 column colour: not known"),
        (HEAD, ROWS.replace("10,1.0", "10,x"), "data.csv:10 column deviation_um: 'x' is no number"),
        (HEAD, ROWS.replace("10,1.0", "10,149998"), "data.csv:10 column deviation_um: 149998 um is no deviation"),
        (HEAD, ROWS.replace("20,", "5,"), "data.csv:11 column angle_deg: a step back in run a"),
        (HEAD, ROWS.replace("20,", "90,"), "data.csv:11 column angle_deg: a step of more than 30 degrees"),
        (HEAD.replace("XY", "XZ"), ROWS, "data.csv:6 plane: 'XZ' is none of XY, YZ, ZX"),
        (HEAD.replace("# plane: XY\n", ""), ROWS, "header line '# plane: XY' or a column plane is missing"),
        (HEAD.replace("# feed: 1000\n", ""), ROWS, "header line '# feed: 1000' or a column feed is missing"),
        (HEAD.replace("# length_mm: 150\n", ""), ROWS, "header line '# length_mm: 150' is missing"),
        (HEAD.replace("# centre: 300 225 150\n", ""), ROWS, "header line '# centre: x y z' is missing"),
        (HEAD.replace("target.t1", "tool"), ROWS, "expected one header line '# target.NAME: x y z', found 0"),
        (HEAD + "# instrument: laser-tracker\n", ROWS, "the instrument is laser-tracker"),
        (HEAD, ROWS.replace("deviation_um", "radius_mm,deviation_um").replace(",1", ",1,1").replace(",-0", ",1,-0"),
         "expected one of the columns deviation_um and radius_mm"),
        (HEAD, ROWS.replace("run\n", "run,direction\n").replace(",a\n", ",a,cw\n"), "the rows of run a go ccw"),
    ],
)  # fmt: skip
def test_refused(write, head, rows, reason):
    with pytest.raises(UserError) as refused:
        read_any(write(head + rows), CFRAME)
    assert reason in str(refused.value)


PROTOCOLS = {
    "TCHPR451.TXT": ("any text\n1 2 3\n", "KinematicsOpt", "FN 16"),
    "TCHPR454.TXT": ("any text\n1 2 3\n", "touch probe cycle", "FN 16"),
    "TCHPR460.TXT": ("any text\n1 2 3\n", "touch probe cycle", "FN 16"),
    "TCHPRAUTO.html": ("<html>\n1 2 3\n", "touch probe cycle", "FN 16"),
    "cut.txt": ("TCHPR", "touch probe cycle", "FN 16"),
    "hole.txt": ("Measuring log for touch probe cycle 421 Hole\n1 2 3\n", "touch probe cycle", "FN 16"),
    "log.txt": ("Date 01.02\nTCH PROBE 451 MEASURE KINEMATICS\nA 0.01\n", "KinematicsOpt", "FN 16"),
    "kin.log": ("; protocol\nCYCLE996 swivel data\n_OVR[1] 0.012\n", "CYCLE996", "siemens-tcarr"),
    "report.csv": ("Renishaw AxiSet Check-Up\nA,0.01\n", "AxiSet", "touch-probe"),
    "run.b5r": ("<?xml version='1.0'?>\n<data/>\n", "Renishaw Ballbar", "angle_deg"),
    "run.xml": ("<?xml version='1.0'?>\n<Ballbar test='1'/>\n", "Renishaw Ballbar", "angle_deg"),
}
"""Names and words by the manuals; the texts are not samples of these programs, whose layout is not public."""


@pytest.mark.parametrize("name", PROTOCOLS)
def test_protocols_are_named_with_the_export_to_use(ncomp, write, name):
    text, title, instead = PROTOCOLS[name]
    path = write(text, name)
    done = ncomp("fit", str(path), "--machine", "dmu50", "-o", "new.json")
    assert done.status == 2
    message = " ".join(done.err.split())
    assert title in message
    assert instead in message
    assert name in message
    assert not Path("new.json").exists()


AS_EXPORTED = {
    "UTF-16": ("KINEMATIK VERMESSEN\r\nStreuung A 0,012\r\n".encode("utf-16"), "log.txt:1: 'KINEMATIK VERMESSEN'"),
    "lower case": (b"tch probe 451 measure kinematics\n", "KinematicsOpt"),
    "French": ("CYCLE 451\r\nMESURER CIN\u00c9MATIQUE\r\nA 0,012".encode("latin-1"), "log.txt:2: 'MESURER CIN"),
    "Italian": (b"MISURA CINEMATICA\rDispersione A 0,012", "log.txt:1: 'MISURA CINEMATICA'"),
    "Spanish, BOM": (b"\xef\xbb\xbfMEDIR CINEMATICA\r\nA 0,012\r\n", "log.txt:1: 'MEDIR CINEMATICA'"),
    "vectors": (b"; swivel data\n$TC_CARR1[1]=0.0005\n", "ncomp import --format siemens-tcarr"),
}
"""Encodings, line ends and languages of controls; the texts are not samples of their protocols."""


@pytest.mark.parametrize(("data", "message"), AS_EXPORTED.values(), ids=AS_EXPORTED)
def test_protocols_in_other_languages_and_encodings_are_named(tmp_path, data, message):
    path = tmp_path / "log.txt"
    path.write_bytes(data)
    with pytest.raises(UserError) as refused:
        read_any(path, CFRAME)
    assert message in str(refused.value)
    assert "It is not read" in str(refused.value)


CUT = {
    "Date 01.02\nMEASURE KINEMAT": "cycles 450 to 453",
    "Date\r\nMeasuring log for tou": "touch probe cycle",
    "; log\nCYCLE9": "CYCLE996",
    "Renishaw Axi": "AxiSet",
    "<?xml version='1.0'?>\n<Ballb": "Renishaw Ballbar",
}
"""Ends of files that were cut off within a word."""


@pytest.mark.parametrize("text", CUT)
def test_files_that_are_cut_off_within_a_word_are_named(tmp_path, text):
    path = tmp_path / "log.txt"
    path.write_text(text)
    with pytest.raises(UserError, match="it was cut off when it was copied") as refused:
        read_any(path, CFRAME)
    assert CUT[text] in str(refused.value)
    assert f"log.txt:{len(text.splitlines())}: " in str(refused.value)


def test_a_word_of_other_texts_shows_no_protocol(tmp_path):
    for text in ("one cycle", "to measure\n", "the preset\n"):
        path = tmp_path / "log.txt"
        path.write_text(text)
        with pytest.raises(UserError, match="the format of the file is unknown"):
            read_any(path, CFRAME)


def test_the_line_that_shows_a_protocol_is_named(write):
    with pytest.raises(
        UserError, match=r"log.txt:2: 'TCH PROBE 451 MEASURE KINEMATICS': this is a protocol of HEIDENHAIN"
    ):
        read_any(write(PROTOCOLS["log.txt"][0], "log.txt"), CFRAME)


def test_a_program_with_such_a_cycle_is_a_program(write):
    with pytest.raises(UserError, match="this is an NC program"):
        read_any(write("0 BEGIN PGM X MM\n1 TCH PROBE 451 MEASURE KINEMATICS\n2 END PGM X MM\n", "x.h"), CFRAME)


def test_a_measurement_that_mentions_one_is_read(write):
    measured, _ = circles_of(step=6.0, seed=1)
    text = "# Renishaw Ballbar, exported\n" + by_angle(measured)
    assert len(read_any(write(text), CFRAME)) == len(measured)


def test_columns_of_another_program_by_a_map(write):
    """Semicolons, decimal commas, deviations in mm, and no column of runs: one circle."""
    measured, _ = circles_of(Backlash("X", 8.0), step=3.0, planes=("XY",), seed=4)
    text = by_angle(measured)
    plain = [line.split(",") for line in text.splitlines() if not line.startswith("#")][1:]
    first = [cells for cells in plain if cells[2] == plain[0][2]]
    rows = "".join(f"{angle};{float(um) / 1e3:.7f}\n".replace(".", ",") for angle, um, *_ in first)
    columns = write(
        'delimiter = ";"\ndecimal = ","\n[columns]\nangle_deg = "Winkel"\ndeviation_um = "Abw."\n[units]\nerrors = "mm"\n'
        '[header]\nmachine = "cframe"\nu_um = 0.3\nlength_mm = 150\ncentre = "300 225 150"\ntarget.t1 = "0 0 -120"\n'
        f'plane = "XY"\nfeed = {first[0][3]}\n',
        "map.toml",
    )
    read = read_any(write("Winkel;Abw.\n" + rows, "export.txt"), CFRAME, columns=str(columns))
    assert read.observed[:, 0] == pytest.approx(measured.observed[: len(first), 0], abs=1e-6)
    assert len(np.unique(read.run)) == 1


def test_semicolons_and_decimal_commas(write):
    """As a German spreadsheet saves them, in the header too."""
    measured, _ = circles_of(Backlash("X", 8.0), step=3.0, planes=("XY",), seed=4)
    text = by_angle(measured)
    german = text.replace(",", ";").replace(".", ",").replace("target,t1", "target.t1")
    assert read_any(write(german), CFRAME).observed == pytest.approx(read_any(write(text), CFRAME).observed)
