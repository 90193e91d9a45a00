"""Every command in the documentation is accepted as it is printed, and runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.command import run_command
from support.docs_commands import PAGES, Command, all_commands, commands
from support.docs_files import prepare
from support.real_data import REAL_DATA

from postproc.commands.options.declared import Signature
from postproc.commands.table import command, named
from postproc.commands.words import Words

BY_PAGE = {page.relative_to(PAGES[0].parent).as_posix(): commands(page) for page in PAGES}
RUN = [name for name, found in BY_PAGE.items() if found and not name.startswith(("docs/tutorial.md", "docs/results/"))]
"""Tests of their own run the tutorial and the results (test_docs_pages.py)."""
SCHEDULER = "tcp://scheduler:8786"
"""The Dask cluster of the pages; the tests start one of this machine."""


@pytest.mark.parametrize("each", all_commands(), ids=lambda each: each.where)
def test_options_are_accepted(each: Command) -> None:
    name, others = named(each.words)
    Words(name, Signature(command(name)[0]).declared).values(others)


@pytest.mark.statistical
@pytest.mark.parametrize("page", RUN)
def test_commands_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page == "docs/measurements/formats.md" and not REAL_DATA.is_dir():
        pytest.skip("the real data (../shared/data) are not beside this repository")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    (tmp_path / "FreeCAD").mkdir()
    for each in BY_PAGE[page]:
        if each.words[0] == "serve":  # it waits for requests: test_serve.py sends them
            continue
        prepare(each.words, tmp_path)
        ends = ["--idle", "0"] if each.words[0] == "watch" else []
        done = run_command(*(word.replace(SCHEDULER, "local") for word in each.words), *ends)
        assert done.status == 0, f"{each.where}: {each.text}\n{done.err}"


def test_the_pages_have_commands() -> None:
    number = len(all_commands())
    print(f"{number} commands in {sum(map(bool, BY_PAGE.values()))} pages")
    assert number >= 110
