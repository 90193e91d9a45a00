"""`ncomp serve`: a page in the browser for programs, measured data and machines."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics.user_error import UserError
from postproc.commands.options.declared import OUTPUT, option
from postproc.commands.options.files import file_of_database
from postproc.commands.options.recorded import Database

if TYPE_CHECKING:
    import socket

EPILOG = (
    "Examples:\n\n"
    "`ncomp serve`  then open http://127.0.0.1:8230/\n\n"
    "`ncomp serve --machines shop --history --watch-log watch.log`\n\n"
    "`ncomp serve --host 0.0.0.0`  for other computers, with the token that it prints"
)
TOKEN = re.compile(r"[A-Za-z0-9_-]{16,}")
"""Tokens that fit into an address, and that nobody guesses."""
VARIABLE = "NCOMP_MACHINES"


def serve(
    *,
    machines: tuple[Path, ...] = option(
        "Folder of machine files, in addition to NCOMP_MACHINES.", "FOLDER", reads=True
    ),
    history: bool = option("Show the lives of the machines (ncomp history).", default=False, panel=OUTPUT),
    db: Database,
    watch_log: Path | None = option("Log of ncomp watch, whose end is shown.", "FILE", reads=True),
    host: str = option("Address at which browsers reach the page.", "ADDRESS", default="127.0.0.1"),
    port: int = option("Port; 0: a free one.", "N", default=8230, min=0, max=65535),
    token: str | None = option(
        "Token that browsers must know, 16 letters or more; default: none at 127.0.0.1, else one is made and printed.",
        "TOKEN",
    ),
    jobs: int = option("Jobs that run at once.", "N", default=2, min=1, max=64),
    largest_mb: float = option("Largest upload, MB.", "MB", default=200.0, min=0.001),
    upload_s: float = option("Time, s, in which an upload must be complete.", "s", default=300.0, min=0.1),
    keep_minutes: float = option("Time, minutes, after which results are removed.", "MINUTES", default=120.0, min=0.01),
) -> None:
    """Show a page in the browser: correct programs, evaluate measured data, see machines, their trends and a watch.

    The forms are the options of the commands, and the results their pages. Nothing is sent to other computers, and
    uploads and results are in a private folder that is removed at the end. Ctrl-C ends the command with status 0.
    """
    _require_packages()
    if machines:
        _offer(machines)
    if token is not None and not TOKEN.fullmatch(token):
        raise UserError(
            "--token: expected 16 letters, digits, - and _ or more: leave it out, and ncomp makes one and prints it"
        )
    address = _database(db) if history or db else None
    from postproc.commands.serve.guard import Limits
    from postproc.commands.serve.server import Server

    limits = Limits(round(1e6 * largest_mb), upload_s)
    Server(_bound(host, port), host, token, address, watch_log, limits, jobs, 60.0 * keep_minutes).run()


def _require_packages() -> None:
    """UserError where the packages of the server are missing."""
    try:
        import python_multipart  # noqa: F401
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as fault:
        raise UserError(f"ncomp serve needs the package {fault.name}: pip install 'ncomp[serve]'") from None


def _database(db: str | None) -> str:
    """The database, from whatever folder it is used; UserError for one that cannot be read."""
    from history.database import default_address, opened

    address = db or default_address()
    with opened(address, writes=False):
        file = file_of_database(address)
    return address if file is None else str(file.absolute())


def _offer(folders: tuple[Path, ...]) -> None:
    """Offer the machine files of folders, also to the commands that the page runs."""
    for folder in folders:
        if not folder.is_dir():
            raise UserError(f"--machines {folder}: there is no such folder: name one with machine files (.toml)")
    named = [*map(str, map(Path.absolute, folders)), *filter(None, [os.environ.get(VARIABLE)])]
    os.environ[VARIABLE] = os.pathsep.join(named)


def _bound(host: str, port: int) -> socket.socket:
    """A socket at an address; UserError for one that is in use, or that is none of this computer."""
    import errno
    import socket

    try:
        (family, _, _, _, address), *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        return socket.create_server((address[0], port), family=family)
    except OSError as fault:
        if fault.errno == errno.EADDRINUSE:
            raise UserError(
                f"--port {port}: another program uses this port, perhaps another ncomp serve: end it, or choose "
                "another port; --port 0 takes a free one"
            ) from None
        if fault.errno in (errno.EACCES, errno.EPERM):
            raise UserError(f"--port {port}: this user may not use this port: choose one above 1023") from None
        raise UserError(
            f"--host {host}: this is no address of this computer: give 127.0.0.1, or 0.0.0.0 for all of its addresses"
        ) from None
