"""A form as it was sent becomes a job: its files are saved under names that this module makes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from kinematics.user_error import UserError
from postproc.commands.serve.forms import HEAD, TABLE_SUFFIXES, Field, Offered, Task, output_name, page_name
from postproc.commands.serve.jobs import Job

COPIED_BYTES = 1 << 20
"""Bytes that are copied at a time."""
MOST_NAME_CHARACTERS = 80
"""Most characters of a name that is shown."""


async def saved_job(
    task: Task, form: Any, offered: Offered, new_folder: Callable[[], Path], own: Mapping[str, Sequence[str]]
) -> Job:
    """The job of a form; own: words of the server by the names of options. UserError for a form without its input."""
    fields = task.fields((*task.shown, *task.folded), offered)
    names = _machine(form, offered) if not task.suffixes else _uploaded(form, "input")
    options = {each.name: each.words(_texts(form, each.name)) for each in fields if each.kind != "file"}
    folder = new_folder()
    try:
        return await _saved(
            task, form, [each for each in fields if each.kind == "file"], {**own, **options}, names, folder
        )
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


async def _saved(
    task: Task,
    form: Any,
    files: Sequence[Field],
    options: Mapping[str, Sequence[str]],
    given: Sequence[Any],
    folder: Path,
) -> Job:
    """The job with its files on the disk."""
    options = dict(options)
    for each in files:
        uploads = _uploaded(form, each.name, needed=False)
        saved = [await _save(one, folder / f"{each.name}{k}", TABLE_SUFFIXES) for k, one in enumerate(uploads, start=1)]
        options[each.name] = [f"{each.declared.label}={name}" for name in saved]
    if task.suffixes:
        kind = "program" if task.output == ".*" else "data"
        inputs = [await _save(one, folder / f"{kind}{k}", task.suffixes) for k, one in enumerate(given, start=1)]
        shown = [_shown(one.filename) for one in given]
    else:
        inputs = shown = list(given)
    names = ", ".join(shown)
    (folder / HEAD).write_text(f"[report]\nremarks = {json.dumps(names, ensure_ascii=False)}\n", encoding="utf-8")
    steps = [task.words(command, options, inputs) for command in task.commands]
    return Job(
        task.title,
        names,
        folder,
        steps,
        _results(task, inputs, shown[0]),
        [page_name(each) for each in task.commands],
    )


def _results(task: Task, inputs: Sequence[str], shown: str) -> dict[str, str]:
    """The files that a job makes, with names for people."""
    stem, last = PurePath(shown).stem, task.commands[-1]
    made = {page_name(last): f"{stem}.html", page_name(last, ".json"): f"{stem}_results.json"}
    if task.output:
        name = output_name(task, inputs)
        suffix = PurePath(shown).suffix if task.output == ".*" else task.output
        made = {name: f"{stem}_{'c' if task.output == '.*' else task.commands[-1]}{suffix}", **made}
    return made


def _texts(form: Any, name: str) -> list[str]:
    """The values of a field."""
    return [each for each in form.getlist(name) if isinstance(each, str)]


def _uploaded(form: Any, name: str, *, needed: bool = True) -> list[Any]:
    """The uploaded files of a field; a browser sends a file without a name for none. UserError for none."""
    found = [each for each in form.getlist(name) if not isinstance(each, str) and each.filename]
    if needed and not found:
        raise UserError("Choose a file first.")
    return found


def _machine(form: Any, offered: Offered) -> list[str]:
    """The machine of a form, which must be one of those that are offered."""
    name = form.get("machine")
    if name not in offered["machine"]():
        raise UserError("Choose a machine of the list.")
    return [name]


async def _save(upload: Any, path: Path, suffixes: Sequence[str]) -> str:
    """Save a file; returns its name in the folder. Its suffix is one of the list."""
    given = PurePath(upload.filename).suffix.lower()
    path = path.with_name(path.name + (given if given in suffixes else suffixes[0]))
    with path.open("xb") as file:
        while part := await upload.read(COPIED_BYTES):
            file.write(part)
    return path.name


def _shown(name: str) -> str:
    """The last part of the name of an upload, as far as it can be shown; with no folder of any system."""
    last = name.replace("\\", "/").rpartition("/")[2]
    return "".join(c for c in last if c.isprintable())[-MOST_NAME_CHARACTERS:].lstrip(".") or "file"
