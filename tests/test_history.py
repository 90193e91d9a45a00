"""`ncomp history`: the life of machines in SQLite and in a real PostgreSQL: what is entered, refused, and never lost."""

from __future__ import annotations

import json
import shutil
import signal
import sqlite3
from pathlib import Path

import pytest
from support.command import refusal, succeed
from support.forked import run_forked, start_forked
from support.history_cases import calibration, entries

from history.database import opened
from history.entries import entries_of
from history.schema import VERSION, Base
from history.trends.series import series_of

ROOT = Path(__file__).parents[1]
CHECK = "squareness X-Y=12.4 +- 3 um/m"


@pytest.fixture(params=["sqlite", "postgresql"])
def db(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database."""
    request.getfixturevalue("command")
    if request.param == "sqlite":
        return str(tmp_path / "life.sqlite")
    return request.getfixturevalue("postgres_server").database()


def test_a_life_is_entered_listed_shown_and_exported(db, tmp_path):
    cal = calibration(tmp_path / "march.json")
    succeed("history", "add", "cframe", cal, "--db", db)
    succeed(
        "history",
        "add",
        "cframe",
        "--check",
        CHECK,
        "--at",
        "2026-04-01T10:00+00:00",
        "--method",
        "granite",
        "--db",
        db,
    )
    succeed("history", "event", "cframe", "crash", "--at", "2026-04-02", "--note", "table hit", "--db", db)
    first, check, crash = entries(db)
    assert first["kind"] == "calibration"
    assert first["at"].startswith("2026-03-01T00:00")
    assert {f["name"]: (f["unit"], round(f["value"], 6), round(f["u"], 6)) for f in first["figures"]}[
        "squareness X-Y"
    ] == ("um/m", 20.0, 2.0)
    assert (check["method"], check["figures"]) == (
        "granite",
        [{"name": "squareness X-Y", "unit": "um/m", "value": 12.4, "u": 1.5}],
    )
    assert (crash["kind"], crash["title"]) == ("crash", "table hit")
    assert json.loads(succeed("history", "list", "--db", db, "--json", "-").out)["machines"] == [
        {"machine": "cframe", "entries": 3, "first": first["at"], "last": crash["at"]}
    ]
    assert "squareness X-Y" in succeed("history", "show", "cframe", "--db", db).shown
    succeed("history", "export", "cframe", "-o", tmp_path / "out", "--db", db)
    assert (tmp_path / "out" / f"{first['entry']}-calibration.json").read_bytes() == cal.read_bytes()
    assert (
        f"{check['entry']},2026-04-01T10:00:00.000000+00:00,check,granite,squareness X-Y,um/m,12.4,1.5"
        in (tmp_path / "out/figures.csv").read_text()
    )


def test_a_file_that_is_changed_or_gone_is_noticed(db, tmp_path):
    one, other = (calibration(tmp_path / f"{day}.json", day=day) for day in ("2026-03-01", "2026-06-01"))
    succeed("history", "add", "cframe", one, other, "--db", db)
    assert "4 of 4" in succeed("history", "verify", "--db", db).shown
    one.write_bytes(one.read_bytes() + b"\n")
    other.unlink()
    assert "2 of 4 files and documents of the history are not as they were entered" in refusal(
        "history", "verify", "--db", db
    )


def test_a_second_check_of_an_instant_needs_its_time(db):
    add = "history", "add", "cframe", "--db", db, "--at", "2026-02-02"
    succeed(*add, "--check", CHECK)
    message = refusal(*add, "--check", CHECK.replace("=1", "=2"))
    assert "UTC: enter it by 'ncomp history add' with the date and the time, --at 2026-02-02T14:30" in message


def test_what_contradicts_the_history_is_refused_and_changes_nothing(db, tmp_path):
    cal = calibration(tmp_path / "a.json")
    succeed("history", "add", "cframe", cal, "--db", db)
    before = entries(db)
    sister = calibration(tmp_path / "sister.json", name="cframe-2")
    future = ("--check", CHECK, "--at", "2999-01-01")
    for words, reason in {
        ("cframe", cal): "the history has it already, as entry",
        ("cframe", calibration(tmp_path / "b.json", 21.0)): "another calibration of the same instant",
        ("cframe", calibration(tmp_path / "c.json", machine="gantry")): "is of machine gantry",
        ("cframe", sister): "is of machine cframe-2, not of cframe",
        ("cframe", *future): "is in the future: give its date with --at, or set the clock",
        ("cframe", "--check", "squareness X-Y=12"): "expected NAME=VALUE +- U UNIT",
        ("cframe", tmp_path / "none.json"): "No such file",
    }.items():
        assert reason in refusal("history", "add", *words, "--db", db)
    assert entries(db) == before
    good = calibration(tmp_path / "d.json", day="2026-05-01")
    assert "of machine gantry" in refusal("history", "add", "cframe", good, tmp_path / "c.json", "--db", db)
    assert entries(db) == before, "all files or none"


def test_another_geometry_of_the_same_name_is_another_machine(db, tmp_path):
    succeed("history", "event", "cframe", "service", "--at", "2026-01-01", "--db", db)
    own = tmp_path / "own.toml"
    own.write_text((ROOT / "machines/trunnion_ac.toml").read_text().replace('name = "trunnion_ac"', 'name = "cframe"'))
    assert "another geometry than the machine of this name" in refusal("history", "event", own, "crash", "--db", db)


@pytest.mark.usefixtures("command")
def test_a_clock_that_went_back_and_a_newer_database_are_refused(tmp_path):
    db = tmp_path / "life.sqlite"
    succeed("history", "event", "cframe", "crash", "--at", "2026-01-01", "--db", db)
    with sqlite3.connect(db) as connection:
        connection.execute("UPDATE entry SET entered_at = '2998-01-01T00:00:00.000000+00:00'")
    assert "the last entry was made at 2998-01-01 00:00 UTC: set the clock" in refusal(
        "history", "event", "cframe", "moved", "--db", db
    )
    succeed("history", "event", "cframe", "moved", "--force", "--db", db)
    with sqlite3.connect(db) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '999'")
    connection.close()
    for words in (("list",), ("event", "cframe", "moved")):
        assert "a newer version of ncomp has written it" in refusal("history", *words, "--db", db)


@pytest.mark.usefixtures("command")
def test_a_locked_a_foreign_and_a_missing_database_are_refused(tmp_path):
    db = tmp_path / "life.sqlite"
    succeed("history", "event", "cframe", "crash", "--at", "2026-01-01", "--db", db)
    holder = sqlite3.connect(db)
    holder.execute("BEGIN EXCLUSIVE")
    assert "another program holds it: wait" in refusal(
        "history", "event", "cframe", "moved", "--db", f"sqlite:///{db}?timeout=0.1"
    )
    holder.close()
    other = sqlite3.connect(tmp_path / "other.sqlite")
    other.execute("CREATE TABLE bookmarks (name TEXT)")
    other.close()
    (tmp_path / "text.sqlite").write_text("this is no database, but a text that is long enough " * 20)
    for name, reason in {
        "none.sqlite": "there is no such database (did you mean 'other.sqlite'?): 'ncomp history add' makes it",
        "other.sqlite": "this is the database of another program",
        "text.sqlite": "this is no database",
        "mysql://host/db": "expected a file, or postgresql://",
        "postgresql://ncomp@127.0.0.1:1/none": "start the server, or correct the address",
    }.items():
        assert reason in refusal("history", "list", "--db", name)


def ended(*words: object, before: str = "") -> tuple[int, str]:
    """Exit status of a process of the command line, and what it has said; `before`: Python that it runs first."""
    done = run_forked(*words, before=before)
    return done.returncode, done.stderr.decode()


def test_two_writers_at_once_lose_nothing(db):
    words = ("history", "add", "cframe", "--check", CHECK, "--db", db)
    pair = [start_forked(*words, "--at", f"2026-0{n}-01") for n in (1, 2)]
    for process in pair:
        process.join(60)
    assert [process.exitcode for process in pair] == [0, 0]
    assert [each["at"][:7] for each in entries(db)] == ["2026-01", "2026-02"]


KILLED = """
import os
from sqlalchemy import Engine, event
def kill(connection, cursor, statement, *_):
    if 'INSERT INTO figure' in statement:
        os.kill(os.getpid(), 9)
event.listen(Engine, 'before_cursor_execute', kill)
"""


def test_a_killed_process_leaves_the_history_as_it_was(db):
    """The first transaction makes the tables too: a migration that is interrupted leaves nothing."""
    words = ("history", "add", "cframe", "--check", CHECK, "--at", "2026-01-01", "--db", db)
    for before in (False, True):
        if before:
            succeed("history", "event", "cframe", "crash", "--at", "2025-01-01", "--db", db)
        status, said = ended(*words, before=KILLED)
        assert status == -signal.SIGKILL, said
        if before:
            assert [each["kind"] for each in entries(db)] == ["crash"]
    succeed(*words)
    assert [each["kind"] for each in entries(db)] == ["crash", "check"]


@pytest.mark.usefixtures("command")
def test_a_full_disk_loses_nothing(tmp_path):
    db = tmp_path / "life.sqlite"
    succeed("history", "event", "cframe", "crash", "--at", "2026-01-01", "--db", db)
    cal = calibration(tmp_path / "a.json")
    cal.write_bytes(cal.read_bytes() + b" " * 200_000)
    size = db.stat().st_size
    full = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size + 50_000}, {size + 50_000}))"
    status, message = ended("history", "add", "cframe", cal, "--db", db, before=full)
    assert status == 2, message
    assert "make room on it" in message
    assert [each["kind"] for each in entries(str(db))] == ["crash"]


def test_the_migrations_make_the_tables_of_the_code(db):
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext
    from alembic.script import ScriptDirectory
    from sqlalchemy import create_engine

    from history.database import _url

    succeed("history", "event", "cframe", "crash", "--at", "2026-01-01", "--db", db)
    engine = create_engine(_url(db))
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    engine.dispose()
    assert ScriptDirectory(str(ROOT / "history/migrations")).get_current_head() == VERSION


def of_version_1(db: str) -> None:
    """Make a database as version 1 had it, with one event."""
    succeed("history", "event", "cframe", "crash", "--at", "2026-01-01", "--db", db)
    with opened(db, writes=True) as session:
        connection = session.connection()
        connection.exec_driver_sql("DROP TABLE cause")
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '1'")


def version_of(db: str) -> tuple[str, bool]:
    """The version of the tables, and whether that of causes is there."""
    from sqlalchemy import create_engine, inspect, text

    from history.database import _url

    engine = create_engine(_url(db))
    with engine.connect() as connection:
        found = str(connection.scalar(text("SELECT version_num FROM alembic_version")))
        tables = inspect(connection).get_table_names()
    engine.dispose()
    return found, "cause" in tables


def test_a_database_of_an_earlier_version_is_changed_when_it_is_read(db):
    of_version_1(db)
    assert version_of(db) == ("1", False)
    assert [each["kind"] for each in entries(db)] == ["crash"]
    assert version_of(db) == (VERSION, True)
    succeed("history", "add", "cframe", "--check", CHECK, "--at", "2026-02-01", "--db", db)
    assert [each["causes"] for each in entries(db)] == [[], []]


KILLED_MIGRATION = KILLED.replace("INSERT INTO figure", "UPDATE alembic_version")


def test_a_migration_that_is_interrupted_leaves_the_earlier_version(db):
    of_version_1(db)
    for words in (("list", "cframe"), ("event", "cframe", "moved")):
        status, said = ended("history", *words, "--db", db, before=KILLED_MIGRATION)
        assert status == -signal.SIGKILL, said
    assert version_of(db) == ("1", False)
    assert [each["kind"] for each in entries(db)] == ["crash"]
    assert version_of(db) == (VERSION, True)


def test_commands_enter_their_results(ncomp, tmp_path):
    db = tmp_path / "life.sqlite"
    (tmp_path / "mill.toml").write_text('history = "life.sqlite"\n' + (ROOT / "machines/gantry.toml").read_text())
    for arguments in (
        ("square", "--ac", 319, "--bd", 318, "--ad", 199, "--machine", "mill.toml"),
        ("in.nc", "--machine", "mill.toml", "--calibration", "cal.json", "-o", "out.nc", "--set-up-zero"),
        ("in.nc", "--machine", "gantry", "--calibration", "cal.json", "-o", "again.nc", "--set-up-zero"),
    ):
        succeed(*arguments)
    square, program = entries(str(db), "gantry")
    assert square["kind"] == "check"
    assert [f["name"] for f in square["figures"]] == ["squareness X-Y"]
    assert program["title"].startswith("in.nc: (NCOMP ")
    mark = program["title"].removeprefix("in.nc: ")
    assert mark in (tmp_path / "out.nc").read_text()
    shutil.copy(tmp_path / "out.nc", tmp_path / "loaded.nc")
    succeed("history", "add", "mill.toml", "loaded.nc")
    assert entries(str(db), "gantry")[-1]["title"] == f"loaded.nc: {mark}"
    done = ncomp("in.nc", "--machine", "mill.toml", "--calibration", "cal.json", "-o", "no/out.nc", "--set-up-zero")
    assert done.status == 2
    assert len(entries(str(db), "gantry")) == 3
    assert "--db x.sqlite: is the database of the history: give --history too" in refusal(
        "square", "--ac", 319, "--bd", 318, "--ad", 199, "--db", "x.sqlite"
    )


@pytest.mark.usefixtures("command")
def test_the_same_data_again_count_once(tmp_path):
    db, data = tmp_path / "life.sqlite", tmp_path / "x.csv"
    succeed(
        "simulate",
        "--machine",
        "cframe",
        "--strategy",
        "axes",
        "--spacing",
        100,
        "--runs",
        2,
        "--instrument",
        "interferometer",
        "-o",
        data,
    )
    data.write_text("# measured: 2026-03-01\n" + data.read_text())
    history = ("--history", "--db", db)
    for output in ("first.csv", "again.csv"):
        succeed("iso230", data, "--machine", "cframe", "-o", output, *history)
        assert (tmp_path / output).is_file()
    assert [each["kind"] for each in entries(str(db))] == ["iso230-2"]
    for basis in ("legendre:1", "legendre:2"):
        succeed("fit", data, "--machine", "cframe", "--basis", basis, "-o", "cal.json", *history)
    assert [each["kind"] for each in entries(str(db))] == ["iso230-2", "calibration", "calibration"]
    with opened(str(db), writes=False) as session:
        second = entries_of(session)[-1].id
        (positioning,) = (each for each in series_of(entries_of(session)) if each.name == "positioning X")
    assert positioning.entries == (second,)
    # other data against the present calibration do not take its place
    (tmp_path / "june.csv").write_text(data.read_text().replace("2026-03-01", "2026-06-01"))
    succeed(
        "diagnose",
        "june.csv",
        "--machine",
        "cframe",
        "--calibration",
        "cal.json",
        "--force",
        "-o",
        "june.json",
        *history,
    )
    with opened(str(db), writes=False) as session:
        (positioning,) = (each for each in series_of(entries_of(session)) if each.name == "positioning X")
    assert positioning.entries == (second, second + 1)
