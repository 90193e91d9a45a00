"""Logs of process variables: what is paired, which way the axis went and how fast, and what is refused."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

import machines
from calibration.fit.calibrate import calibrate
from calibration.instruments import Interferometer
from calibration.measurement.readers import read_any
from kinematics.effects import Cyclic
from kinematics.user_error import UserError

SINGLE = machines.load(str(Path(__file__).parents[1] / "examples" / "single_axis.toml"))
DMU50 = machines.load("dmu50")
GIVEN = {"command": "ioc:cmd", "observed": "ioc:enc", "axis": "X", "u_um": "0.5"}
START = np.datetime64("2020-12-08T16:17:33.317076", "us")


def line(name: str, seconds: float, value: float) -> str:
    day, clock = str(START + np.timedelta64(round(seconds * 1e6), "us")).split("T")
    return f"{name:<22} {day} {clock} {value:.6g}  "


def motion(n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Time and position, 100 Hz: 0.5 s of standing, there at 5 mm/s, 0.5 s of standing, and back."""
    time = np.arange(n) / 100.0
    return time, np.interp(time, [0.5, 2.0, 2.5, 4.0], [1.0, 8.5, 8.5, 1.0])


def log(time, command, observed, late=0.0) -> str:
    rows = [line("ioc:cmd", *row) for row in zip(time, command, strict=True)]
    rows += [line("ioc:enc", *row) for row in zip(time + late, observed, strict=True)]
    return "\n".join([*rows, line("ioc:other", 0.0, 7.0)]) + "\n"


@pytest.fixture
def read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def read_text(text: str, machine=SINGLE, **header: str):
        Path("a.log").write_text(text)
        return read_any(Path("a.log"), machine, header={**GIVEN, **header})

    return read_text


def test_there_and_back(read):
    time, x = motion()
    m = read(log(time, x, x + 0.012))
    assert m.instrument == Interferometer(0.5)
    np.testing.assert_allclose(m.state.time, time, atol=1e-6)
    np.testing.assert_allclose(m.state.positions[:, 0], x, atol=1e-5)
    np.testing.assert_allclose(m.observed[:, 0], 0.012, atol=2e-5)
    assert m.state.approach[:, 0].tolist() == [1.0] * 246 + [-1.0] * 154
    assert set(m.run) == {"1"}
    np.testing.assert_allclose(m.feed[[0, 100, 220, 300]], [0, 300, 0, 300], atol=1e-3)
    np.testing.assert_allclose(m.state.velocity[[0, 100, 220, 300], 0], [0, 5, 0, -5], atol=1e-4)
    assert m.where(0) == "a.log:401"
    assert m.notes[0] == "values taken in mm of X, deviation observed minus command in um"
    assert m.notes[1].startswith("X moves at 300 mm/min: ")
    assert "X is at standstill in 87 rows, the first on line 1 (0.00 s): they are used like the others" in m.notes
    assert any(note.startswith("X accelerates, brakes or moves at another speed in ") for note in m.notes)


def test_second_way_there_is_another_run(read):
    time = np.arange(900) / 100.0
    x = np.interp(time, [0.0, 3.0, 6.0, 9.0], [0.0, 6.0, 0.0, 6.0])
    m = read(log(time, x, x))
    assert abs(np.argmax(m.run == "2") - 600) <= 5
    assert set(m.run) == {"1", "2"}


def test_every_row_is_counted(read):
    """Values that lack a partner, and stamps that differ, are told."""
    time, x = motion()
    text = log(time, x, x, late=0.002).split("\n")
    del text[600:605], text[10:12]
    m = read("\n".join(text))
    assert len(m) == 400 - 7
    assert m.notes[:3] == (
        "5 values of ioc:cmd are left out: the other variable has no value within half a sample",
        "2 values of ioc:enc are left out: the other variable has no value within half a sample",
        "the two values of a pair differ in time by up to 2 ms",
    )


def test_of_a_rotary_axis(read):
    time, c = motion()
    m = read(log(time, c, c + 0.001), DMU50, axis="C")
    np.testing.assert_allclose(m.observed[:, 0], np.radians(0.001), atol=np.radians(2e-5))
    np.testing.assert_allclose(m.state.positions[:, DMU50.index("C")], np.radians(c), atol=1e-6)
    assert abs(m.feed[100] - 300.0) < 0.001
    assert m.notes[0] == "values taken in deg of C, deviation observed minus command in urad"


TEXT = log(*motion(), motion()[1])


@pytest.mark.parametrize(
    ("text", "header", "words"),
    [
        (TEXT, {"command": ""}, "command is missing: state --header command=NAME, one of ioc:cmd, ioc:enc, ioc:other"),
        (TEXT, {"observed": "enc"}, "observed 'enc' is not in the log: state --header observed=NAME, one of ioc:cmd"),
        (TEXT, {"observed": "ioc:cmd"}, "command and observed are both ioc:cmd"),
        (TEXT, {"observed": "ioc:other"}, "1 values of ioc:other are too few"),
        (TEXT, {"axis": "Y"}, "axis 'Y' is none of machine single_axis (w b X t)"),
        (TEXT, {"u_um": "0"}, "uncertainty (k=1) of the interferometer is missing"),
        (TEXT.replace("33.417076 1", "33.417076 one", 1), {}, "a.log:11: 'one' is no number"),
        (TEXT.replace("33.417076 1", "33.417076 1 HIGH MINOR", 1), {}, "a.log:11: 'ioc:cmd"),
        (TEXT.replace("16:17:33.417", "16:17:32.417", 1), {}, "a.log:11: the time of ioc:cmd does not increase"),
        (TEXT.replace("2020-12-08 16:17:33.417", "2020-13-08 16:17:33.417", 1), {}, "a.log:11: 2020-13-08 16:17:33.417076 is not a time"),
        (log(*motion(), motion()[1], late=20.0), {}, "only 0 values of ioc:cmd and ioc:enc were taken within half a sample"),
    ],
)  # fmt: skip
def test_refused(read, text, header, words):
    with pytest.raises(UserError) as fault:
        read(text, **header)
    assert words in str(fault.value)


def test_cyclic_error_is_fitted(read):
    """A period that is not quite the one expected, from a log to its parameters."""
    time, x = motion()
    error = 0.008 * np.sin(2 * np.pi * x / 0.501)
    m = read(log(time, x, x + error))
    found = calibrate(m, basis="legendre:1", effects=[Cyclic("X", "X", 0.5, (0.0,), (0.0,))], hold_out=False)
    cyclic = next(e for e in found.model.effects if isinstance(e, Cyclic))
    assert abs(cyclic.period - 0.501) < 1e-4
    assert abs(cyclic.sine[0] - 8.0) < 0.2
    assert found.fit.rms_um < 0.1


def test_real_slit_axis(command, slit_log):
    """A resolver of 0.25 mm a turn: fundamental and harmonics leave less than 0.5 um of 14.6."""
    example = Path(__file__).parents[1] / "examples" / "single_axis.toml"
    done = command(
        "fit", slit_log, "--machine", example, "--header", "axis=X", "--header", "u_um=0.5",
        "--header", "command=IOC_TEST:Axis1-PosAct", "--header", "observed=IOC_TEST:ec0-s4-EL7211-Enc-PosAct",
        "--basis", "cubic:12", "--no-hold-out", "-o", "cal.json", "--json", "fit.json",
        "--effect", "cyclic:component=X,axis=X,period=0.2502,sine=[0,0,0,0,0],cosine=[0,0,0,0,0]",
    )  # fmt: skip
    assert done.status == 0, done.err
    assert "X moves at 15 mm/min: 4303 of 4303 rows" in done.err
    result = msgspec.json.decode(Path("fit.json").read_bytes())
    assert 14.0 < result["before"]["rms_um"] < 15.0
    assert result["after"]["rms_um"] < 0.5
    cyclic = next(e for e in result["effects"] if e["name"].startswith("cyclic"))
    assert abs(cyclic["parameters"]["period_mm"] - 0.25) < 1e-4
