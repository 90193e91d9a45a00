"""Results depend on the input alone: not on chunks, on earlier runs in the process, or on later text."""

import dataclasses
import io
import pickle
import sys
from collections.abc import Mapping
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from types import MappingProxyType, ModuleType

import msgspec
import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from support.diagnosis_cases import data_with
from support.program_runs import BEGINS, DIALECTS, REFUSED, Program, corrected, everything, job_of, programs
from support.tiers import drawn, quick

import machines
from calibration.observation.stops_and_lines import held_out_blocks, lines
from postproc.correct.check import check
from postproc.correct.pipeline import Pipeline
from postproc.motion.motions import COLUMNS
from postproc.verification.verify import read_motions

seeds = st.integers(0, 2**32 - 1)


def in_chunks(patch, size):
    """Work on so many blocks at a time."""
    for module in ("execution", "correct.check", "verification.in_step"):
        patch.setattr(f"postproc.{module}.CHUNK_BLOCKS", size)


OVER_THE_END = Program(
    "gantry", "iso", "G21 G90 G17 G94\nG54 G0 X0. Y0. Z0.\nG52 X-18.\nG1 X3. Y4. Z5. F500\nG52 X0.\n"
)
"""The second move ends outside the travel of X, and the tables of the errors."""


@drawn(
    few=2,
    many=10,
    also={"program": OVER_THE_END, "seed": 1, "size": 1},
    program=programs(),
    seed=seeds,
    size=st.sampled_from([1, 2, 3, 7]),
)
def test_chunks_change_nothing(program, seed, size):
    job = job_of(program, seed)
    whole = everything(job)
    with pytest.MonkeyPatch.context() as patch:
        in_chunks(patch, size)
        parted = everything(job)
    assert parted == whole


def interrupted(job):
    """Run a job and stop it after its first chunk."""

    def stop(_):
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        in_chunks(patch, 2)
        with pytest.raises(KeyboardInterrupt):
            Pipeline(job).run(io.BytesIO(), stop)


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("size", [1, 2, 3, 5])
def test_lines_that_check_refuses_do_not_depend_on_chunks(dialect, size):
    """They are listed in the order of the program, and none behind its end, wherever a chunk ends."""
    refused = REFUSED[dialect]
    text = "".join([BEGINS[dialect], refused, MOVES[dialect], UNKNOWN[dialect], refused, "M30\n", refused])
    job = job_of(Program("gantry", dialect, text), 0)
    whole = check(job.source, job.dialect, job.machine, job.setup)
    with pytest.MonkeyPatch.context() as patch:
        in_chunks(patch, size)
        parted = check(job.source, job.dialect, job.machine, job.setup)
    assert parted == whole
    assert len(whole.refused) == 3
    assert whole.refused == sorted(whole.refused)


MOVES = {"iso": "G1 X5. Y5. Z5. F500\n", "siemens": "G1 X5 Y5 Z5 F500\n", "heidenhain": "L X+5 Y+5 Z+5 F500\n"}
UNKNOWN = {"iso": "G1 X#500\n", "siemens": "G1 X=R500\n", "heidenhain": "L X+Q99\n"}


@drawn(few=1, many=5, first=programs(), second=programs(), seed=seeds)
def test_a_run_leaves_nothing_to_the_next(first, second, seed):
    """After another program, after a refused one and after one that was stopped, on the same machine and set-up."""
    job = job_of(first, seed)
    alone = everything(job)
    other = job_of(second, seed + 1)
    everything(other)
    refused = dataclasses.replace(first, text=first.text + REFUSED[first.dialect])
    assert "refused" in everything(msgspec.structs.replace(job, source=job_of(refused, seed).source))
    if "text" in alone:
        interrupted(job)
    assert everything(job) == alone
    assert everything(job_of(first, seed)) == alone


TAILS = {
    "iso": {
        "loop": "#1=0\nWHILE[#1LT2]DO1\nG1 X1. F500\n#1=#1+1\nEND1\n",
        "subprogram": "M98 P77\nM30\nO77\nG1 X7. F500\nM99\n",
        "offset": "G10 L2 P1 X77. Y5.\n",
        "variable": "#101=7\n",
        "tool": "T2 M6\nG43 H2\n",
    },
    "siemens": {
        "loop": "FOR R90=1 TO 2\nG1 X1 F500\nENDFOR\n",
        "subprogram": "UP7\nM30\n%_N_UP7_SPF\nG1 X7 F500\nM17\n",
        "offset": "$P_UIFR[1,X,TR]=77\n$P_UIFR[1,Y,FI]=5\n",
        "variable": "R1=7\n",
        "tool": "$TC_DP3[1,1]=77\n",
    },
    "heidenhain": {
        "loop": "LBL 99\nL X+1 F500\nCALL LBL 99 REP1\n",
        "subprogram": "CALL LBL 77\nM30\nLBL 77\nL X+7 F500\nLBL 0\n",
        "offset": "CYCL DEF 7.0 DATUM SHIFT\nCYCL DEF 7.1 X+77\n",
        "variable": "Q1=7\n",
        "tool": "TOOL DEF 1 L77\n",
    },
}
"""Text behind a program: what it sets holds from there on."""


def lines_of(found):
    """The corrected lines, without the mark: its comment names all work offsets and tools that the program uses."""
    return [line for line in found["text"].splitlines() if "NCOMP" not in line]


@drawn(
    few=2,
    many=10,
    program=programs(),
    seed=seeds,
    names=st.lists(st.sampled_from(sorted(TAILS["iso"])), min_size=1, unique=True),
)
def test_lines_do_not_depend_on_later_text(program, seed, names):
    """Except for refusals, and for these decisions, which need more than the lines before:

    - the last position before a feed move of rotary axes alone may be left as in the input (turning.py): no tail
      begins with such a move;
    - a program may be of another dialect by later words: the dialect is given here;
    - the mark in the head names the used set-up, and conditions that were accepted.
    """
    text = program.text
    for end in ("END PGM PART MM\n", "M30\n"):
        text = text.removesuffix(end)
    head = dataclasses.replace(program, text=text)
    tail = "".join(TAILS[program.dialect][name] for name in sorted(names, key=lambda name: name == "subprogram"))
    alone = corrected(job_of(head, seed))
    followed = corrected(job_of(dataclasses.replace(head, text=text + tail), seed))
    assume("text" in alone and "text" in followed)
    lines = lines_of(alone)
    assert lines_of(followed)[: len(lines)] == lines


MODULES = ("postproc", "calibration", "rendering", "kinematics", "machines", "grammars")
KEPT = {("kinematics.error_transform", "_loaded"), ("calibration.study.chunks", "_prepared")}
"""Caches: derived code by the geometry of its machine, and cases of a study by all that decides their results."""


DERIVED = (lines, held_out_blocks)
"""Functions that are `derived` from a measurement alone."""
GIVEN = tuple(f"data[{name!r}]" for name in ("machine", "state", "observed"))
"""What a measurement is made of."""


def shown(value, depth=8):
    """The content of a value in words, without what is worked out once and kept."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, dict | MappingProxyType):
        return [(shown(key), shown(entry, depth - 1)) for key, entry in value.items()] if depth else "..."
    if isinstance(value, list | tuple | set | frozenset):
        return [shown(entry, depth - 1) for entry in value] if depth else "..."
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [field.name for field in dataclasses.fields(value) if field.init]
        return [(name, shown(getattr(value, name), depth - 1)) for name in fields] if depth else "..."
    if isinstance(value, msgspec.Struct):
        return (
            [(name, shown(entry, depth - 1)) for name, entry in msgspec.structs.asdict(value).items()]
            if depth
            else "..."
        )
    return repr(value) if isinstance(value, str | float | int | None | StrEnum) else str(type(value))


def state_of_modules():
    """Every global of ncomp's modules that are loaded, without caches."""
    return {
        (name, key): shown(value)
        for name, module in sorted(sys.modules.items())
        if name.split(".")[0] in MODULES
        for key, value in vars(module).items()
        if not key.startswith("__") and not isinstance(value, ModuleType) and (name, key) not in KEPT
    }


def writable(value, path, seen):
    """Paths of arrays in a value that can be changed."""
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            yield path
    elif isinstance(value, Mapping):
        for key, entry in value.items():
            yield from writable(entry, f"{path}[{key!r}]", seen)
    elif isinstance(value, list | tuple):
        for i, entry in enumerate(value):
            yield from writable(entry, f"{path}[{i}]", seen)
    elif (dataclasses.is_dataclass(value) or isinstance(value, msgspec.Struct)) and not isinstance(value, type):
        for name, entry in fields_of(value).items():
            yield from writable(entry, f"{path}.{name}", seen)


def fields_of(value):
    """Fields of an instance and its cached results, by name."""
    fields = msgspec.structs.asdict(value) if isinstance(value, msgspec.Struct) else {}
    return fields | getattr(value, "__dict__", {})


@pytest.mark.parametrize("name", quick(machines.names(), ["dmu50"]))
def test_runs_change_neither_modules_nor_what_they_are_given(name):
    """Every shipped machine, in every dialect: correct, check and verify."""
    jobs = [job_of(Program(name, dialect, BEGINS[dialect] + MOVES[dialect]), 1) for dialect in DIALECTS]
    for job in jobs:
        everything(job)  # everything is loaded and derived
    modules, given_ = state_of_modules(), [shown((job.machine, job.setup, job.conditions)) for job in jobs]
    for job in jobs:
        everything(job)
    assert state_of_modules() == modules
    assert [shown((job.machine, job.setup, job.conditions)) for job in jobs] == given_
    assert not [path for job in jobs for path in writable(job.machine, name, set())]


def test_no_module_holds_an_array_that_can_be_changed():
    found = [
        path
        for name, module in sorted(sys.modules.items())
        if name.split(".")[0] in MODULES and not name.startswith("machines.calibrations")
        for key, value in vars(module).items()
        if not key.startswith("__") and (name, key) not in KEPT
        for path in writable(value, f"{name}.{key}", set())
    ]
    assert not found


def test_moves_are_read_only():
    job = job_of(Program("gantry", "iso", BEGINS["iso"] + MOVES["iso"]), 1)
    motions = read_motions(job.source, job.dialect, job.machine, job.setup)[0]
    for name in COLUMNS:
        assert not getattr(motions, name).flags.writeable
        assert not getattr(pickle.loads(pickle.dumps(motions)), name).flags.writeable
    derived = [name for name, value in vars(type(motions)).items() if isinstance(value, cached_property)]
    assert {"programmed", "machine_target", "tool"} <= {*derived}
    for name in derived:
        assert getattr(motions, name) is getattr(motions, name)
        assert not any(column.flags.writeable for column in columns_of(getattr(motions, name)))


def test_what_is_derived_from_a_measurement_is_kept_and_read_only():
    data = data_with(stations=2)
    names = {name for name, value in vars(type(data)).items() if isinstance(value, cached_property)}
    of_an_interferometer = {"axis_column", "axis_position"}
    for name in names - of_an_interferometer:
        assert getattr(data, name) is getattr(data, name)
    for derive in DERIVED:
        assert derive(data) is derive(data)
    assert [path for path in writable(vars(data), "data", set()) if not path.startswith(GIVEN)] == []
    moved = dataclasses.replace(data, observed=data.observed + np.array([0.0, 0.0, 5.0]))
    shift = [next(iter(each.first_registration[0].poses.values())).translation for each in (moved, data)]
    assert np.allclose(np.subtract(*shift), [0.0, 0.0, 5.0])
    again = pickle.loads(pickle.dumps(data))
    assert all(np.array_equal(getattr(again, name), getattr(data, name)) for name in ("nominal_points", "whiteners"))
    assert np.array_equal(lines(again), lines(data))


def columns_of(value):
    """The arrays of a column, or of columns together."""
    if isinstance(value, np.ndarray):
        return [value]
    each = fields_of(value).values() if dataclasses.is_dataclass(value) or isinstance(value, msgspec.Struct) else value
    return [column for part in each for column in columns_of(part)]


def test_a_page_has_the_notes_of_its_own_command(command):
    """Also behind a command in the same process that was refused, or that had no page."""
    head = "G21 G90 G17 G54 G94\nG0 X10 Y10 Z200 B{} C0\nG1 X20 F500\n{}M30\n"
    for name, text in (
        ("a.nc", head.format(20, "")),
        ("b.nc", head.format(0, "")),
        ("c.nc", head.format(30, "G234\n")),
    ):
        Path(name).write_text(text)
    setup = ("--machine", "dmu50", "--set-up-zero")
    own = "first used at B20"
    assert command("correct", "a.nc", *setup, "-o", "a1.nc").status == 0
    assert command("correct", "c.nc", *setup, "-o", "c1.nc", "--report", "c.html").status == 2
    for name, shown in (("b", False), ("a", True), ("b", False)):
        done = command("correct", f"{name}.nc", *setup, "-o", f"{name}2.nc", "--report", f"{name}.html")
        assert done.status == 0, done.err
        assert (own in Path(f"{name}.html").read_text()) == shown
        Path(f"{name}.html").unlink()
        Path(f"{name}2.nc").unlink()
