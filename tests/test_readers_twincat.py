"""Exports of TwinCAT Scope: channels, times, units, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import machines
from calibration.instruments import Interferometer
from calibration.measurement.readers import read_any
from kinematics.user_error import UserError

SINGLE = machines.load(str(Path(__file__).parents[1] / "examples" / "single_axis.toml"))
DMU50 = machines.load("dmu50")
GIVEN = {"command": "Count", "observed": "Resolver", "u_um": "0.5"}
FIRST = 132900081483250000
"""Ticks of the first row."""


def rows(n: int = 40) -> list[tuple[int, float, float]]:
    """Ticks of 100 ns, command and observation: out at 5 mm/s and back, every 10 ms, without a standstill."""
    there = np.append(np.arange(n // 2), np.arange(n // 2, 0, -1)) * 0.05
    return [(FIRST + 100_000 * i, x, x + 0.0123) for i, x in enumerate(there.tolist())]


def export(delimiter: str = ";", unit: str = "(None)", scale: str = "1", decimal: str = ".") -> str:
    lines = [
        "Name;Resolver test;",
        f"Starttime of export;{FIRST};Tuesday, February 22, 2022;13:55:48.325",
        "",
        "Name;Count;fActVelocity;Resolver",
        f"Unit;{unit};(None);{unit}",
        f"ScaleFactor;{scale};1;1",
        "Offset;0;0;0",
        "SymbolName;MAIN.Count;MAIN.Velocity;GVL.Resolver",
        "",
        *(f"{tick};{x:.6g};5;{y:.6g}".replace(".", decimal) for tick, x, y in rows()),
        "EOF",
    ]
    return "\r\n".join(lines).replace(";", delimiter) + "\r\n"


@pytest.fixture
def read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def read_text(text: str, machine=SINGLE, **header: str):
        Path("s.csv").write_text(text, newline="")
        return read_any(Path("s.csv"), machine, header={**GIVEN, **header})

    return read_text


@pytest.mark.parametrize("text", [export(), export("\t", decimal=","), export(decimal=",")])
def test_out_and_back(read, text):
    m = read(text)
    assert m.instrument == Interferometer(0.5)
    np.testing.assert_allclose(m.state.time, np.arange(40) / 100, atol=1e-9)
    np.testing.assert_allclose(m.state.positions[:, 0], [x for _, x, _ in rows()], atol=1e-6)
    np.testing.assert_allclose(m.observed[:, 0], 0.0123, atol=1e-8)
    assert set(np.sign(m.state.approach[:, 0])) == {1.0, -1.0}
    assert m.where(0) == "s.csv:10"
    assert "the export gives no unit of command: it is taken in mm" in m.notes


def test_units_and_symbol_names(read):
    m = read(export(unit="m"), observed="GVL.Resolver")
    np.testing.assert_allclose(m.observed[:, 0], 12.3, atol=1e-4)
    m = read(export(unit="°"), DMU50, axis="C")
    np.testing.assert_allclose(m.observed[:, 0], np.radians(0.0123), atol=1e-9)
    assert m.notes[0] == "values taken in deg of C, deviation observed minus command in urad"
    assert not any("no unit" in note for note in m.notes)


def test_channels_with_their_own_times(read):
    body = [f"{tick};{x:.6g};{tick};{y:.6g}" for tick, x, y in rows()]
    lines = ["Name;test", f"Starttime of export;{FIRST};", "", "Name;Count;Name;Resolver", "Unit;mm;Unit;mm", "", *body]
    m = read("\n".join(lines))
    np.testing.assert_allclose(m.observed[:, 0], 0.0123, atol=1e-8)
    assert "the line EOF is missing at the end: the export may be incomplete" in m.notes
    lines[10] = lines[10].replace(f";{rows()[4][0]};", f";{rows()[4][0] + 1};")
    with pytest.raises(UserError, match=r"s.csv:11: the times of command and observed differ"):
        read("\n".join(lines))


TEXT = export()


@pytest.mark.parametrize(
    ("text", "header", "words"),
    [
        (TEXT, {"command": ""}, "command is missing: state --header command=NAME, one of Count, fActVelocity, Resolver"),
        (TEXT, {"observed": "X"}, "observed 'X' is no channel: state --header observed=NAME, one of Count, fActVel"),
        (TEXT, {"observed": "MAIN.Count"}, "command and observed are both Count"),
        (TEXT, {"axis": "Y"}, "axis 'Y' is none of machine single_axis (w b X t)"),
        (TEXT.replace(";Resolver", ";Count"), {}, "s.csv:4: several channels have the name 'Count'"),
        (export(scale="2"), {}, "ScaleFactor of command is 2: whether the exported values contain it is not known"),
        (export(unit="bar"), {}, "unit 'bar' of command is none of mm, m, inch, um, for X"),
        (TEXT.replace("0.05;5", "0.0x5;5", 1), {}, "s.csv:11 column Count: '0.0x5' is no number"),
        (TEXT.replace("00081483350000", "00081483250000"), {}, "s.csv:11: the time does not increase"),
        (TEXT.replace("\n1329000814", "\n81"), {}, "8183250000 is no absolute time in ticks of 100 ns"),
        (TEXT.replace("00081483350000;", "00081483350000.5;"), {}, "is no time in ticks of 100 ns"),
        (TEXT.replace("Name;Count", "Title;Count"), {}, "the line with the names of the channels, 'Name;...', is missing"),
        ("\n".join(TEXT.splitlines()[:15]), {}, "6 rows of data, 'time;value...', are too few for a motion"),
    ],
)  # fmt: skip
def test_refused(read, text, header, words):
    with pytest.raises(UserError) as fault:
        read(text, **header)
    assert words in str(fault.value)
