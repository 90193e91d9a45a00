"""The date of a measurement: from the data, from the header or from an option; the validity begins then."""

import datetime
import json
from pathlib import Path

import pytest

from calibration.measurement.measuring_date import date_in

PLATE = """Plug Plate: 1597A
Date: 2003-10-17

    Meas X    Meas Y     Nom X     Nom Y     Err X     Err Y
"""
HOLES = [(x, y) for x in range(-250, 251, 50) for y in range(-240, 241, 60)]
PROGRAM = "G21 G90\nG0 X2500 Y1500 Z200\nG1 X2550 F500\nM30\n"


def plate(head=PLATE):
    rows = [
        f"{x + 0.02 * (x / 250) ** 2:10.3f}{y + 0.03 * y / 240:10.3f}{x:10.3f}{y:10.3f}"
        f"{0.02 * (x / 250) ** 2:10.3f}{0.03 * y / 240:10.3f}"
        for x, y in HOLES
    ]
    Path("plate.txt").write_text(head + "\n".join(rows) + "\n")


def fitted(command, *options):
    done = command(
        "fit",
        "plate.txt",
        "--machine",
        "gantry",
        "--header",
        "u_um=1",
        "--basis",
        "legendre:2",
        "-o",
        "cal.json",
        "--report",
        "p.html",
        *options,
    )
    assert done.status == 0, done.err
    return json.loads(Path("cal.json").read_text())["provenance"], done.err, Path("p.html").read_text()


@pytest.mark.parametrize(
    ("text", "date"),
    [
        ("Date: 2003-10-17", (2003, 10, 17)),
        ("Date:12:30 2001-02-03", (2001, 2, 3)),
        ("* Date        : Wed Apr  6 14:51:47 CEST 2022", (2022, 4, 6)),
        ("Starttime of export;132900081483250000;Tuesday, February 22, 2022;13:55:48.325", (2022, 2, 22)),
        ("IOC:Axis1-PosAct      2020-12-08 16:17:33.317076 0.900391", (2020, 12, 8)),
        ("Datum: 17.10.2003", (2003, 10, 17)),
        ("Date: 3 Apr 2019", (2019, 4, 3)),
        ("Date: 03/04/2003", None),
        ("Date of measurement: 3 April 2019", (2019, 4, 3)),
        ("Datum der Messung: Mo, 17.10.2003", (2003, 10, 17)),
        ("Measured on Friday, 17 October 2003", (2003, 10, 17)),
        ("Date and time = 2003-10-17 08:15", (2003, 10, 17)),
        ("Date of calibration: 2001-02-03", None),
        ("Date of last calibration 12.03.2019\nDate: 2024-05-06", (2024, 5, 6)),
        ("Datum der Kalibrierung: 12.03.2019", None),
        ("Date due: 2030-01-01", None),
        ("Date modified 2020-01-02", None),
        ("Update 2003-10-17", None),
        ("Date: 2003-13-17", None),
    ],
)
def test_only_a_date_of_one_meaning_is_read(text, date):
    assert date_in(f"title\n{text}\n1 2 3\n") == (None if date is None else datetime.date(*date))


def test_a_calibration_of_old_data_is_stale(command):
    plate()
    provenance, err, page = fitted(command)
    assert provenance["measured_on"] == "2003-10-17"
    assert "--measured" not in err
    assert "<dt>measured</dt><dd>2003-10-17</dd>" in page
    Path("part.nc").write_text(PROGRAM)
    options = ("--machine", "gantry", "-c", "cal.json", "--set-up-zero", "-o", "out.nc")
    done = command("part.nc", *options)
    assert done.status == 2
    assert "was measured on 2003-10-17" in done.err
    assert "--accept stale" in done.err
    assert "stale" not in command("part.nc", *options, "--accept", "stale,insignificant,worse").err


def test_the_option_states_the_date_and_comes_before_that_of_the_data(command):
    plate(PLATE.replace("Date: 2003-10-17\n", ""))
    provenance, err, page = fitted(command)
    assert "measured_on" not in provenance
    assert "the data state no date" in err
    today = datetime.datetime.now(datetime.UTC).date()
    assert "<dt>measured</dt><dd></dd>" in page
    day = str(today - datetime.timedelta(days=3))
    assert fitted(command, "--measured", day)[0]["measured_on"] == day
    plate()
    assert fitted(command, "--measured", day)[0]["measured_on"] == day


@pytest.mark.parametrize("text", ["17.10.2003", "yesterday", "2999-01-01"])
def test_another_text_is_refused(command, text):
    plate()
    done = command("fit", "plate.txt", "--machine", "gantry", "--header", "u_um=1", "-o", "c.json", "--measured", text)
    assert done.status == 2
    assert "measured" in done.err
    assert ("2003-10-17" if "2999" not in text else "future") in done.err
