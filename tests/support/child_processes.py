"""The processes that a process has started, by the files of Linux about them."""

from pathlib import Path


def children(process: int) -> set[int]:
    """The running processes that a process has started."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = path.read_text().rsplit(")", 1)[1].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(words[1]) == process and words[0] != "Z":
            found.add(int(path.parent.name))
    return found
