"""The database of a shop: a file of SQLite, or a server of PostgreSQL, opened for one transaction.

One writer at a time: SQLite locks its file, PostgreSQL an advisory lock of ncomp, both until the transaction ends. A
transaction that does not end well, or whose process is killed, changes nothing; so does a migration, which is part of
the first transaction of a newer version of ncomp.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics.files import writing
from kinematics.files.mistaken import missing
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from sqlalchemy import URL, Connection, Engine
    from sqlalchemy.orm import Session

VARIABLE = "NCOMP_HISTORY"
"""Environment variable with the database, a file or an address."""
FILE = "history.sqlite"
WAIT_S = 30
"""Time for which a writer waits for another one, s: far longer than a transaction takes."""
WRITER = int.from_bytes(b"ncomp", "big")
"""The advisory lock of the one writer in PostgreSQL."""
CURES = {
    "SQLITE_BUSY": "another program holds it: wait until that one ends, and repeat the command",
    "SQLITE_FULL": "the disk is full: make room on it, and repeat the command",
    "SQLITE_IOERR": "the disk is full, or does not answer: make room on it, and repeat the command",
    "SQLITE_READONLY": "change its permissions, or name another database with --db",
    "SQLITE_CANTOPEN": "name a file in a folder that exists and can be written",
    "SQLITE_NOTADB": "this is no database: name that of the history with --db",
    "SQLITE_CORRUPT": "the file is damaged: restore it from its last copy",
}
"""Cures of the faults of SQLite, by the beginnings of their names."""
SERVER = "start the server, or correct the address, and repeat the command"


def default_address() -> str:
    """The database that is used without --db and without one in the machine file."""
    import platformdirs

    return os.environ.get(VARIABLE) or str(Path(platformdirs.user_data_dir("ncomp")) / FILE)


def shown(address: str) -> str:
    """The address without a password."""
    return _url(address).render_as_string(hide_password=True) if "://" in address else address


@contextmanager
def opened(address: str, *, writes: bool) -> Iterator[Session]:
    """A session in one transaction, which is committed when the block ends well; UserError for one that fails."""
    from sqlalchemy.exc import DBAPIError
    from sqlalchemy.orm import Session

    from history.schema import VERSION

    try:
        with _engine(address, writes).begin() as connection:
            if writes and connection.dialect.name == "postgresql":
                connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITER})")
            present = _version(connection, shown(address))
            if present != VERSION and writes:
                _migrate(connection)
            if present == VERSION or writes:
                with Session(connection) as session:
                    yield session
                    session.flush()
                return
        with opened(address, writes=True) as session:  # an older version
            yield session
    except DBAPIError as fault:
        raise UserError(f"history {shown(address)}: {_reason(fault.orig)}; nothing was changed") from None


def _url(address: str) -> URL:
    """The address as a URL; UserError for one of another kind of database."""
    from sqlalchemy import URL, make_url
    from sqlalchemy.exc import ArgumentError

    if "://" not in address:
        return URL.create("sqlite", database=address)
    try:
        url = make_url(address)
    except ArgumentError:
        raise UserError(f"--db {address}: expected a file, or postgresql://USER@HOST/DATABASE") from None
    if url.drivername in ("postgresql", "postgres"):
        return url.set(drivername="postgresql+psycopg")
    if url.drivername not in ("sqlite", "postgresql+psycopg"):
        raise UserError(f"--db {url.render_as_string()}: expected a file, or postgresql://USER@HOST/DATABASE")
    return url


def _engine(address: str, writes: bool) -> Engine:
    from sqlalchemy import NullPool, create_engine, event

    url = _url(address)
    if url.drivername != "sqlite":
        return _server(url)
    path = Path(url.database or "")
    if not writes and not path.is_file():
        raise UserError(
            f"history {path}: there is no such database{missing(path)}: 'ncomp history add' makes it, and --db names "
            "another one"
        )
    if path == Path(default_address()):
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
    wait = {} if "timeout" in url.query else {"timeout": WAIT_S}
    engine = create_engine(url, poolclass=NullPool, connect_args={**wait, "isolation_level": None})
    begin = "BEGIN IMMEDIATE" if writes else "BEGIN"
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql(begin))
    return engine


def _server(url: URL) -> Engine:
    from sqlalchemy import NullPool, create_engine

    try:
        import psycopg  # noqa: F401
    except ImportError:
        raise UserError(
            f"--db {url.render_as_string()}: PostgreSQL needs a package: pip install 'ncomp[postgres]'"
        ) from None
    options = {"connect_timeout": WAIT_S, "options": f"-c lock_timeout={WAIT_S}s"}
    return create_engine(url, poolclass=NullPool, connect_args=options)


def _version(connection: Connection, name: str) -> str:
    """The version of the tables, empty without any; UserError for a newer one, and for tables of another program."""
    from sqlalchemy import inspect, text

    from history.schema import VERSION

    tables = inspect(connection).get_table_names()
    if "alembic_version" not in tables:
        if tables:
            raise UserError(f"history {name}: this is the database of another program: name that of ncomp with --db")
        return ""
    present = str(connection.scalar(text("SELECT version_num FROM alembic_version")))
    if not present.isdecimal() or int(present) > int(VERSION):
        raise UserError(
            f"history {name}: a newer version of ncomp has written it (tables {present}, this one knows {VERSION}): "
            "pip install --upgrade ncomp"
        )
    return present


def _migrate(connection: Connection) -> None:
    """Run the migrations that are missing, in the present transaction."""
    from alembic.config import Config
    from alembic.runtime.environment import EnvironmentContext
    from alembic.script import ScriptDirectory

    script = ScriptDirectory(str(Path(__file__).parent / "migrations"))

    def missing_ones(present: Any, _: Any) -> Any:
        return script._upgrade_revs("head", present)

    with EnvironmentContext(Config(), script, fn=missing_ones) as environment:
        environment.configure(connection=connection, transactional_ddl=True)
        environment.run_migrations()


def _reason(fault: BaseException | None) -> str:
    """The reason of a fault of the database, with its cure."""
    text = str(fault).strip().partition("\n")[0] or type(fault).__name__
    name = getattr(fault, "sqlite_errorname", None)
    if name is None:
        return f"{text}: {SERVER}"
    cure = next((cure for begin, cure in CURES.items() if name.startswith(begin)), "repeat the command")
    return f"{text}: {cure}"
