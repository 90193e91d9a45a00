"""Reports of ISO 230-2 tests by ecmc: what is read of them, and what is refused."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

import machines
from calibration.instruments import Interferometer
from calibration.measurement.readers import read_any
from kinematics.user_error import UserError

EXAMPLE = Path(__file__).parents[1] / "examples" / "single_axis.toml"
SINGLE, DMU50 = machines.load(str(EXAMPLE)), machines.load("dmu50")
REPORT = """\
# ecmc motion system test report

* Date        : Wed Apr  6 14:51:47 CEST 2022

# Gear Ratios
From | To | Ratio [] | Offset [mm] | Data count [] | Residual error [mm²]
--- | --- | --- | --- | --- | --- |
Target Position | Reference | -1.00357 | 50.31931 | 4.00000 | .09780742

# ISO 230-2 motion test

Setting | Value
--- | --- |
Position count | 2 (i=1..2)
Cycle count |2 (j=1..2)
Unit | mm

### Data forward direction

ref_pos(i,j) = Reference position at position i and cycle j [mm]

i |tgt_pos(i) [mm]|ref_pos(i,1) [mm]|ref_pos(i,2) [mm]|
--- |--- |--- |--- |
1|-20.0|-20.01852|-20.01934|
2|5.0|5.00129|5.00219|

### Data backward direction

i |tgt_pos(i) [mm]|ref_pos(i,1) [mm]|ref_pos(i,2) [mm]|
--- |--- |--- |--- |
1|-20.0|-20.04923|-20.0525|
2|5.0|4.97245|4.96836|

#### Positioning deviation forward direction (unidirectional)

i |x(i,1) [mm]|x(i,2) [mm]|x_avg(i) [mm]|
--- |--- |--- |--- |
1|-0.01852|-0.01934|-0.01893|
2|0.00129|0.00219|0.00174|

### Repeatability

i |S_fwd(i) [mm]|
--- |--- |
1|0.00163|

# Resolver Performance

Test | Setpoint [mm] | Resolver AVG[mm] |
--- | --- | --- |
1 | 1.00084 | 1.0003100 |
"""


@pytest.fixture
def read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def read_text(text: str, machine=SINGLE, **header: str):
        Path("r.md").write_text(text)
        return read_any(Path("r.md"), machine, header={"u_um": "0.5", **header})

    return read_text


@pytest.mark.parametrize("text", [REPORT, REPORT.replace("\n", "\r\n")])
def test_report(read, text):
    m = read(text)
    assert m.instrument == Interferometer(0.5)
    assert m.axis.tolist() == ["X"] * 8
    assert m.run.tolist() == ["1"] * 4 + ["2"] * 4
    assert m.state.approach[:, 0].tolist() == [1, 1, -1, -1] * 2
    assert m.state.positions[:, 0].tolist() == [-20, 5, 5, -20] * 2
    np.testing.assert_allclose(
        m.observed[:, 0] * 1e3, [-18.52, 1.29, -27.55, -49.23, -19.34, 2.19, -31.64, -52.5], atol=1e-9
    )
    assert m.where(0) == "r.md:24"
    assert m.notes[:3] == (
        "read as an ISO 230-2 test of X in mm: deviation ref_pos minus tgt_pos, 2 cycles",
        "the report gives neither times nor the order of readings: cycle after cycle, forward before backward",
        "line 8: the reference is multiplied by -1.00357 and shifted by 50.31931 mm to fit the targets: scale and zero "
        "of X are not in these data",
    )


def test_report_of_a_rotary_axis(read):
    m = read(REPORT.replace("mm]", "deg]"), DMU50, axis="C")
    np.testing.assert_allclose(m.observed[:2, 0], np.radians([-0.01852, 0.00129]), atol=1e-11)
    np.testing.assert_allclose(m.state.positions[:2, DMU50.index("C")], np.radians([-20, 5]))


@pytest.mark.parametrize(
    ("change", "machine", "words"),
    [
        (("", ""), DMU50, "r.md: the axis is missing: state --header axis=NAME, one of C, B, X, Y, Z"),
        (("mm]", "deg]"), SINGLE, "r.md:22: unit 'deg' of X is none of mm, m, inch, um"),
        (("4.97245", "4.97x45"), SINGLE, "r.md:32 column ref_pos(i,1): '4.97x45' is no number"),
        (("|5.00219|", "|"), SINGLE, "r.md:25: 3 cells, but 4 columns have names"),
        (
            ("0.00219", "0.00319"),
            SINGLE,
            " column x(i,2): 0.00319 is not ref_pos minus tgt_pos, 0.00219: one of the two",
        ),
        (("|2 (j=1..2)", "|5 (j=1..5)"), SINGLE, "'Cycle count |5 (j=1..5)', but the tables have 2 cycles"),
        (("### Data backward", "### Raw backward"), SINGLE, "the table below 'Data backward direction' is missing"),
        (("ref_pos(i,2) [mm]", "ref_pos(i,2) [um]"), SINGLE, "r.md:22: the columns have different units"),
        (("|ref_pos(i,1)", "|reference(i,1)"), SINGLE, "r.md:22: expected the columns i, tgt_pos(i) [unit]"),
    ],
)
def test_refused(read, change, machine, words):
    with pytest.raises(UserError) as fault:
        read(REPORT.replace(*change), machine)
    assert words in str(fault.value)


def test_real_report(command, ecmc_report):
    """The tables of the report by ISO 230-2: its headline E and R take one direction only, and are not used."""
    done = command("iso230", ecmc_report, "--machine", EXAMPLE, "--header", "u_um=0.5", "--json", "-")
    assert done.status == 0, done.err
    values = msgspec.json.decode(done.out)["axes"][0]["values"]
    found = [values[symbol]["value_um"] for symbol in ("B", "E", "M", "R", "A")]
    assert found == pytest.approx([33.58, 122.85, 93.65, 55.16, 135.26], abs=0.01)
