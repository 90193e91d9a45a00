"""`ncomp init`: a machine file and a job file from questions."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import MACHINE, MODEL, SET_UP, argument, option
from postproc.commands.options.files import check_files, machine_file
from postproc.commands.options.shared import machine_names

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from kinematics.machine import Machine
    from postproc.commands.workplace.answers import Answers

EPILOG = (
    "Examples:\n\n"
    "`ncomp init mill`  asks, and writes mill/NAME.toml, mill/NAME.svg and mill/job.toml\n\n"
    "`ncomp init mill --name hall3 --chain 'w b X Y Z t' --travel X=0:800 --travel Y=0:500 --travel Z=-400:0 "
    "--work-offset G54=100,80,-300 --tool-length T1=95 --program part.nc`  without questions\n\n"
    "`ncomp init job --machine dmu50 --work-offset G54=-30,-20,150 --tool-length T1=80 --program part.nc`  only the job"
)


@dataclass(frozen=True, kw_only=True)
class NewMachine:
    """Answers about the machine."""

    PANEL: ClassVar[str] = MACHINE

    name: str | None = option("Name of the machine, which is also that of its file.", "NAME")
    description: str | None = option("Description of the machine.", "TEXT")
    chain: str | None = option("Chain from the workpiece w over the bed b to the tool t.", "'w C B b X Y Z t'")
    travel: tuple[str, ...] = option("Travel of an axis, mm or degrees.", "X=low:high")
    point: tuple[str, ...] = option("Point on the line of a rotary axis, mm, machine frame.", "C=x,y,z")
    direction: tuple[str, ...] = option("Direction of an axis that differs from that of its letter.", "B=x,y,z")
    home: tuple[str, ...] = option("Reference position of an axis; of Z the upper end of its travel.", "Z=mm")
    family: Literal["any", "fanuc", "linuxcnc", "grbl", "mach3"] | None = option(
        "Control, where controls read ISO code differently."
    )


@dataclass(frozen=True, kw_only=True)
class JobAnswers:
    """Answers about the job."""

    PANEL: ClassVar[str] = "Job"

    machine: str | None = option(
        "Machine that exists already: no machine file is written.",
        "NAME|FILE.toml",
        "-m",
        reads=machine_file,
        panel=MACHINE,
    )
    calibration: str | None = option(
        "Calibration of the job, relative to the folder.", "CAL.json|none", "-c", panel=MODEL
    )
    work_offset: tuple[str, ...] = option("Work offset, mm, of the job.", "G54=x,y,z", panel=SET_UP)
    tool_length: tuple[str, ...] = option("Length of a tool, mm, of the job.", "T1=mm", panel=SET_UP)
    program: tuple[str, ...] = option("Program of the job, relative to the folder.", "IN.nc")


def init(
    *,
    folder: Path = argument(
        "Folder of the files; it is made if it does not exist. Default: the present folder.",
        "FOLDER",
        default=Path(),
        writes="folder",
    ),
    new: NewMachine,
    given: JobAnswers,
    force: bool = option("Replace files that exist.", default=False),
) -> None:
    """Make a machine file and a job file: asks for values that the options leave open, checks them, draws the chain."""
    from postproc.commands.show.chain_svg import chain_svg
    from postproc.commands.show.terminal import say
    from postproc.commands.workplace.answers import Answers
    from postproc.commands.workplace.new_machine import lines_below_the_spindle
    from postproc.interface.job_file import read_job

    answers = Answers()
    files: dict[str, bytes] = {}
    machine, new_machine = given.machine, given.machine is None
    if machine is None:
        name, text = _machine(new, answers)
        found, machine = _parsed(text, f"{name}.toml"), f"{name}.toml"
        files |= {machine: text.encode(), f"{name}.svg": chain_svg(found)}
    else:
        found = ncomp.load_machine(machine)
        if machine not in machine_names() and Path(machine).is_file():
            machine = _from(folder, Path(machine))
    files["job.toml"] = _job(found, machine, given, answers).encode()
    if not force and (there := next((name for name in files if (folder / name).exists()), None)):
        raise UserError(f"{folder / there} exists: name another folder, or replace it by --force")
    _write(folder, files)
    job = read_job(folder / "job.toml", there=False)
    for line in lines_below_the_spindle(found) if new_machine else ():
        say("compare", f"with the machine: {line}; if not, correct point in {folder / machine}")
    for absent in (each.path for each in job.programs if not each.path.exists()):
        say("first", f"put the program at {absent}")
    say("next", f"ncomp {folder / 'job.toml'} --check")
    if b'calibration = "none"' in files["job.toml"]:
        path = folder / "job.toml"
        say("then", f"measure the machine, write its calibration into {path}, and correct by ncomp {path}")


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files by their names into a folder, which is made if it does not exist; UserError where that fails."""
    from kinematics.files import write_whole, writing
    from postproc.commands.show.terminal import say

    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        check_files((), {"FOLDER": folder / name})
        write_whole(folder / name, data)
        say("written", str(folder / name))


def _from(folder: Path, file: Path) -> str:
    """The path of a file from a folder, so that both can be moved together; on another drive its whole path."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return str(file.resolve())


def _machine(new: NewMachine, answers: Answers) -> tuple[str, str]:
    """Name and text of the machine file."""
    from postproc.commands.show.terminal import console
    from postproc.commands.workplace.new_machine import (
        CHAINS,
        FAMILIES,
        GivenAxes,
        machine_text,
        read_chain,
        read_name,
    )

    name = answers.one(new.name, "--name", "Name of the machine", read_name, None)
    description = answers.one(new.description, "--description", "Description", str, "")
    if answers.asks and new.chain is None:
        for number, (chain, kind) in CHAINS.items():
            console.print(f"  {number}  {chain:<18} {kind}")
    chain = answers.one(new.chain, "--chain", "Chain, or its number", read_chain, None)
    family = answers.one(
        new.family, "--family", f"Control: {', '.join(FAMILIES)} (any: HAAS, Siemens, Heidenhain, ...)", _family, "any"
    )
    axes = GivenAxes(new.travel, new.point, new.direction, new.home)
    return name, machine_text(name, description, chain, family, axes, answers)


def _family(text: str) -> str:
    from kinematics.files.mistaken import none_of
    from postproc.commands.workplace.new_machine import FAMILIES

    if text not in FAMILIES:
        raise UserError(none_of(text, FAMILIES))
    return text


def _parsed(text: str, name: str) -> Machine:
    import machines

    return machines.parse(text, name)


def _job(found: Machine, machine: str, given: JobAnswers, answers: Answers) -> str:
    """The text of the job file."""
    from machines import default_calibration
    from postproc.control.setup import parse_tool_length, parse_work_offset

    work_offset, tool_length = given.work_offset, given.tool_length
    own = "" if default_calibration(found) else "none"
    calibration = answers.one(given.calibration, "--calibration", "Calibration: CAL.json, or none", _calibration, own)
    if not work_offset and answers.asks:
        question = "Work offset of the part, mm, G54=x,y,z; empty if it is not known"
        work_offset = _given(answers.one(None, "", question, lambda text: _checked_offset(text, found), ""))
    offsets = dict(parse_work_offset(each, found) for each in work_offset)
    if not tool_length and answers.asks:
        question = "Length of the first tool, mm, T1=mm; empty if it is not known"
        tool_length = _given(answers.one(None, "", question, _checked_tool, ""))
    tools = dict(map(parse_tool_length, tool_length))
    programs = given.program or (
        answers.one(None, "--program", "Program to correct, relative to the folder of the job file", str, "part.nc"),
    )
    return _job_text(machine, calibration, offsets, tools, programs)


def _job_text(
    machine: str,
    calibration: str,
    offsets: Mapping[str, Mapping[str, float]],
    tools: Mapping[str, float],
    programs: Sequence[str],
) -> str:
    """The job file, with examples of a set-up that is not known."""
    from postproc.commands.workplace.new_machine import number

    lines = [f"machine = {json.dumps(machine)}"]
    later = "    # a file of ncomp fit, once the machine is measured" if calibration == "none" else ""
    lines += [f"calibration = {json.dumps(calibration)}{later}"] if calibration else []
    lines += ["", "[work_offsets]"]
    for name, values in offsets.items():
        lines.append(f"{_key(name)} = {{ {', '.join(f'{axis} = {number(value)}' for axis, value in values.items())} }}")
    lines += [] if offsets else ["# G54 = { X = 0, Y = 0, Z = 0 }    # mm, as the offset page of the control shows it"]
    lines += ["", "[tools]", *(f"{_key(name)} = {number(length)}" for name, length in tools.items())]
    lines += [] if tools else ["# 1 = 100.0    # mm, from the spindle nose to the tip"]
    lines += ["", "[programs]"]
    lines += [f"{json.dumps(each)} = {json.dumps(f'corrected/{Path(each).name}')}" for each in programs]
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    """A name as a key of TOML."""
    return name if name.replace("_", "").replace("-", "").isalnum() else json.dumps(name)


def _given(answer: str) -> tuple[str, ...]:
    """An answer, unless it is empty."""
    return (answer,) if answer else ()


def _calibration(text: str) -> str:
    if text not in ("", "none") and Path(text).suffix.lower() != ".json":
        raise UserError(f"{text!r}: expected the .json file of a calibration, or none")
    return text


def _checked_offset(text: str, found: Machine) -> str:
    from postproc.control.setup import parse_work_offset

    if text:
        parse_work_offset(text, found)
    return text


def _checked_tool(text: str) -> str:
    from postproc.control.setup import parse_tool_length

    if text:
        parse_tool_length(text)
    return text
