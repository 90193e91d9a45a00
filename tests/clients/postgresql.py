"""A real server of PostgreSQL, of Debian's package, with a data folder of its own, reached on the loopback only."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path

BIN = Path("/usr/lib/postgresql")
SETTINGS = {"listen_addresses": "127.0.0.1", "fsync": "off", "max_connections": "20"}


def programs() -> Path | None:
    """Folder of the programs of the newest version; None where there is none."""
    found = sorted(BIN.glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    return found[-1].parent if found else None


def available() -> bool:
    """True where Debian's package is installed."""
    return programs() is not None


class Server:
    """A server that runs until it is closed; it does not run as root."""

    def __init__(self) -> None:
        folder = programs()
        assert folder is not None
        self.user = {"user": "postgres", "group": "postgres", "extra_groups": []} if os.geteuid() == 0 else {}
        self.folder = Path(tempfile.mkdtemp(prefix="ncomp-postgresql-"))
        if self.user:
            shutil.chown(self.folder, "postgres", "postgres")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._run(folder / "initdb", "-D", "data", "-U", "ncomp", "-A", "trust", "--no-sync", "-E", "UTF8")
        options = " ".join(f"-c {name}={value}" for name, value in SETTINGS.items())
        options += f" -c port={self.port} -c unix_socket_directories={self.folder}"
        self._run(folder / "pg_ctl", "-D", "data", "-w", "-l", "log", "-o", options, "start")
        self._stop = folder / "pg_ctl", "-D", "data", "-m", "immediate", "stop"
        self._number = 0

    def _run(self, *words: object) -> None:
        log = self.folder / "programs.log"
        with log.open("ab") as out:
            done = subprocess.run(
                list(map(str, words)), cwd=self.folder, stdout=out, stderr=out, check=False,
                env={"PATH": os.environ["PATH"], "LC_ALL": "C.UTF-8", "TZ": "UTC"}, **self.user,
            )  # fmt: skip
        assert done.returncode == 0, log.read_text()

    def database(self) -> str:
        """Address of a new and empty database."""
        import psycopg

        self._number += 1
        name = f"history_{self._number}"
        with psycopg.connect(f"postgresql://ncomp@127.0.0.1:{self.port}/postgres", autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}".encode())
        return f"postgresql://ncomp@127.0.0.1:{self.port}/{name}"

    def close(self) -> None:
        """End the server and remove its data."""
        self._run(*self._stop)
        shutil.rmtree(self.folder)
