"""Temperatures by the clock of a logger, joined to the rows of a measurement, and read by a correction."""

from pathlib import Path

import numpy as np
import pytest

import ncomp
from postproc.compensation.conditions import make_conditions

HEAD = """# machine: gantry
# instrument: interferometer
# u_um: 0.3
"""
ROWS = [("2026-07-01 10:00:00", 0), ("2026-07-01 10:10:00", 500), ("2026-07-01 10:20:00", 1000)]
STAMPED = (
    HEAD
    + "time,axis,run,direction,target_mm,deviation_um\n"
    + "".join(f"{time},X,1,+,{target},{target / 100}\n" for time, target in ROWS)
)
LOG = "time;temp_bed\n" + "".join(f"2026-07-01 {h:02d}:{m:02d}:00;{20 + h - 10 + m / 60:.3f}\n".replace(".", ",")
                                  for h in (9, 10, 11) for m in range(0, 60, 5))  # fmt: skip
"""Semicolons and decimal commas; the bed warms by 1 K in an hour and has 20 degC at ten."""


def read(data=STAMPED, log=LOG, **options):
    for name, text in (("data.csv", data), ("log.csv", log)):
        Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return ncomp.read_measurement("data.csv", "gantry", log="log.csv", **options)


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_stamps_of_rows_and_log_are_joined():
    m = read()
    assert m.state.time.tolist() == [0.0, 600.0, 1200.0]
    assert m.state.temperatures["bed"] == pytest.approx([0.0, 1 / 6, 1 / 3], abs=1e-3)
    assert str(m.measured) == "2026-07-01"
    assert any("no zone is stated" in note and "0 s from a reading" in note for note in m.notes)


def test_a_logger_of_any_form_by_its_map():
    """Date and time in two columns, in degF, in cp1252, below two lines of the maker."""
    log = 'Logger 7\n\nNr.;Datum;Uhrzeit;"Bett °F"\n' + "".join(
        f"{n};01.07.2026;{9 + n // 6:02d}:{n % 6}0;{32 + 1.8 * (20 + n / 6)}\n".replace(".", ",").replace(
            "01,07,", "01.07."
        )
        for n in range(13)
    )
    Path("map.toml").write_text(
        'delimiter = ";"\ndecimal = ","\nskip_lines = 1\n[columns]\ntime = ["Datum", "Uhrzeit"]\ntemp_bed = "Bett °F"\n'
        '[units]\ntime = "%d.%m.%Y %H:%M"\ntemperature = "degF"\n[header]\nzone = "Europe/Berlin"\n',
        encoding="utf-8",
    )
    utc = STAMPED.replace("# u_um", "# zone: UTC\n# u_um").replace(" 10:", " 08:")
    m = read(utc, log.encode("cp1252"), log_columns="map.toml")
    assert m.state.temperatures["bed"] == pytest.approx([1.0, 7 / 6, 8 / 6], abs=1e-3)
    conditions = make_conditions(log="log.csv", log_columns="map.toml")
    assert conditions.elapsed == 7200.0
    assert conditions.temperatures["bed"] == pytest.approx(22.0)


def test_seconds_need_the_moment_of_second_zero():
    seconds = STAMPED.replace("time,axis", "time_s,axis")
    for number, (time, _) in enumerate(ROWS):
        seconds = seconds.replace(time, str(600 * number))
    with pytest.raises(
        ncomp.UserError, match="has time stamps, and the rows time_s: state the date and time of second 0"
    ):
        read(seconds)
    m = read(seconds, header=["measured=2026-07-01 10:30:00"])
    assert m.state.temperatures["bed"] == pytest.approx([0.5, 2 / 3, 5 / 6], abs=1e-3)
    m = read(seconds, "time_s,temp_bed\n0,20\n1200,22\n")
    assert m.state.temperatures["bed"] == pytest.approx([0.0, 1.0, 2.0])


def test_lengths_have_times_too():
    data = "# instrument: lengths\n# u_um: 30\ntime_s,X1,Y1,X2,Y2,length_mm\n0,0,0,600,0,600\n100,0,0,0,600,600\n"
    m = read(data, "time_s,temp_air\n0,20\n100,30\n")
    assert m.state.temperatures["air"].tolist() == [0.0, 0.0, 10.0, 10.0]


AUTUMN = (
    "time,temp_bed\n2026-10-25 02:58:00,20\n2026-10-25 02:59:00,20\n2026-10-25 02:00:00,20\n2026-10-25 02:01:00,21\n"
)
SPRING = (
    "time,temp_bed\n2026-03-29 01:58:00,20\n2026-03-29 01:59:00,20\n2026-03-29 03:00:00,20\n2026-03-29 03:01:00,21\n"
)
SUMMER = LOG.replace("2026-07-01 11", "2026-07-01 12").replace("2026-07-01 10", "2026-07-01 11").replace(" 09:", " 10:")
REFUSED = {
    "end of summer time": (STAMPED, AUTUMN, "log.csv:4, column time: the time is before that of the last row, by 59 min"),
    "begin of summer time": (STAMPED, SPRING, "log.csv:4, column time: the time steps by 61 min, one hour more"),
    "summer time in the log alone": (
        STAMPED.replace(" 10:", " 09:"),
        SUMMER,
        "data.csv:5 column time_s: 2026-07-01 09:00:00 is not in log log.csv, 2026-07-01 10:00:00 to 2026-07-01 12:55:00: "
        "shifted by 1 h it would",
    ),
    "a zone of its own": (
        STAMPED.replace("# u_um", "# zone: UTC\n# u_um").replace("07-01", "11-01"),
        "# zone: Europe/Berlin\ntime,temp_bed\n2026-07-01 10:00:00,20\n",
        "data.csv:6 column time_s: 2026-11-01 11:00:00+0100 is not in log log.csv, 2026-07-01 10:00:00+0200 to",
    ),
    "another day": (STAMPED.replace("07-01", "06-01"), LOG, "give the log of this measurement, or correct its date"),
    "zone in one file": (STAMPED.replace("# u_um", "# zone: UTC\n# u_um"), LOG, "only the measurement states its zone"),
    "unknown zone": (STAMPED, "# zone: Berlin\n" + LOG, "log.csv:3, column time: the zone 'Berlin' is not known"),
    "zone in one row": (STAMPED, LOG.replace("09:05:00", "09:05:00Z"), "of this time stamp and the first only one states"),
    "rows without times": (STAMPED.replace("time,", "point,"), LOG, "is joined by time, and the rows have none"),
    "temperature twice": (
        STAMPED.replace("time,", "temp_bed,time,").replace("2026-07-01 10", "20,2026-07-01 10"),
        LOG,
        "data.csv:4 column temp_bed: log log.csv has it too",
    ),
    "no temperature": (STAMPED, "time\n2026-07-01 10:00\n", "it has no column of temperatures"),
    "hour that does not exist": (
        STAMPED,
        "# zone: Europe/Berlin\ntime,temp_bed\n2026-03-29 02:30:00,20\n",
        "the clock of Europe/Berlin skips this hour",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_joined_is_refused(case):
    data, log, message = REFUSED[case]
    with pytest.raises(ncomp.UserError) as caught:
        read(data, log)
    assert message in str(caught.value)


def test_a_stated_zone_resolves_summer_time():
    conditions = []
    for log in (AUTUMN, SPRING):
        Path("log.csv").write_text("# zone: Europe/Berlin\n" + log)
        conditions.append(make_conditions(log="log.csv"))
    assert [each.elapsed for each in conditions] == [180.0, 180.0]
    assert np.diff(conditions[0].past.time).tolist() == [60.0, 60.0, 60.0]


def test_planned_times_stand_in_with_a_note():
    plan = "# machine: gantry\n# target.t1: 0 0 -120\ntime_s,X,Y,Z,target,point\n0,0,0,0,t1,P1\n600,500,0,0,t1,P2\n"
    Path("plan.csv").write_text(plan)
    m = read(
        "g,s,P1,1,2,3\ng,s,P2,501,2,3\n", LOG, columns="spatialanalyzer", plan="plan.csv",
        header=["measured=2026-07-01 10:00:00"],
    )  # fmt: skip
    assert m.state.temperatures["bed"] == pytest.approx([0.0, 1 / 6], abs=1e-3)
    assert "the export has no times: those that plan.csv plans stand in for them" in m.notes


def test_a_fit_uses_the_temperature_of_a_log(command):
    """X grows by 12 um/m/K: the data have no other error, and the fit finds it from the log alone."""
    rows = [(run, target) for run in range(6) for target in (0, 500, 1000, 1500)]
    warm = {run: 20.0 + run for run in range(6)}
    data = HEAD + "time,axis,run,direction,target_mm,deviation_um\n" + "".join(
        f"2026-07-01 {8 + run:02d}:{target // 100:02d}:00,X,{run},+,{target},"
        f"{12e-3 * (warm[run] - 20) * target + (0.2 if (run + target // 500) % 2 else -0.2):.3f}\n"
        for run, target in rows
    )  # fmt: skip
    log = "time,temp_bed\n" + "".join(
        f"2026-07-01 {8 + run:02d}:{minute:02d}:00,{warm[run]}\n" for run in range(6) for minute in (0, 20, 40)
    )
    Path("data.csv").write_text(data)
    Path("log.csv").write_text(log)
    arguments = [
        "fit",
        "data.csv",
        "--machine",
        "gantry",
        "-o",
        "cal.json",
        "--log",
        "log.csv",
        "--basis",
        "legendre:1",
    ]
    done = command(*arguments, "--effect", "thermal-scale-sensor:axis=X,sensor=bed,coefficient=0")
    assert done.status == 0, done.err
    (growth,) = (
        e for e in ncomp.load_calibration("gantry", "cal.json").effects if type(e).__name__ == "GrowthWithSensor"
    )
    assert growth.coefficient == pytest.approx(12.0, abs=0.3)
