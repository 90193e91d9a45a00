"""`ncomp codes`: what a code means to ncomp, by its name or by words, and for a family of controls."""

import json
from pathlib import Path

import pytest

import machines


def found(ncomp, *words):
    done = ncomp("codes", *words, "--json", "-")
    assert done.status == 0, done.err
    return json.loads(done.out)


def rows(result):
    return [(row["dialect"], row["code"], row["verdict"]) for row in result["codes"]]


@pytest.mark.parametrize(("words", "expected"), [
    (("G43.4",), [("iso", "G43.4", "followed")]),
    (("g05.1",), [("iso", "G5.1", "passes")]),
    (("M128",), [("iso", "M128", "refused"), ("heidenhain", "M128", "followed")]),
    (("m128", "--dialect", "heidenhain"), [("heidenhain", "M128", "followed")]),
    (("cycle81",), [("siemens", "CYCLE81", "followed")]),
    (("CYCL", "DEF", "200"), [("heidenhain", "cycle 200", "followed")]),
    (("cycle", "12"), [("heidenhain", "cycle 12", "followed")]),
    (("fn17",), [("heidenhain", "FN 17", "refused")]),
    (("HOLES1",), [("siemens", "HOLES1", "noted")]),
    (("L",), [("heidenhain", "L", "followed")]),
    (("G234",), []),
])  # fmt: skip
def test_a_code_by_its_name(ncomp, words, expected):
    assert rows(found(ncomp, *words)) == expected


def test_words_of_the_meaning(ncomp):
    codes = {(row["dialect"], row["code"]) for row in found(ncomp, "cuts", "thread")["codes"]}
    assert {("iso", "G32"), ("siemens", "G33")} <= codes
    assert ("iso", "G1") not in codes
    assert found(ncomp, "no such meaning")["codes"] == []


@pytest.mark.parametrize(("family", "code", "verdict"), [
    ("linuxcnc", "G43.1", "followed"), ("fanuc", "G43.1", "refused"), ("any", "G43.1", "refused"),
    ("any", "G43", "followed"),
])  # fmt: skip
def test_a_code_as_a_family_reads_it(ncomp, family, code, verdict):
    text = (Path(machines.__file__).parent / "gantry.toml").read_text()
    Path("mill.toml").write_text(f'{text}\n[control]\nfamily = "{family}"\n')
    assert rows(found(ncomp, code, "--family", family)) == [("iso", code, verdict)]
    assert rows(found(ncomp, code, "--machine", "mill.toml")) == [("iso", code, verdict)]
    # the verdict is that of a program with the code
    length = "G43.1 Z10." if code == "G43.1" else "G43 H1"
    Path("a.nc").write_text(f"G21 G17 G90 G54\nT1 M6\n{length}\nG0 X10. Y10. Z100.\nM30\n")
    read = ncomp("check", "a.nc", "--machine", "mill.toml", "--set-up-zero", "--no-travel-check")
    assert read.status == (0 if verdict == "followed" else 2)


def test_the_reason_of_a_refusal_and_the_controls_that_are_meant(ncomp):
    shown = ncomp("codes", "G12.1").out.decode()
    assert "selects polar or cylindrical interpolation" in shown
    assert "LinuxCNC 2.9" in shown
    assert "--pass-through" in ncomp("codes", "G234").out.decode()


def test_codes_that_the_machine_file_lets_pass(ncomp):
    text = (Path(machines.__file__).parent / "gantry.toml").read_text()
    Path("mill.toml").write_text(f'{text}\n[control]\npass_through = ["G234"]\n')
    assert {row[1:] for row in rows(found(ncomp, "G234", "--machine", "mill.toml"))} == {("G234", "passes")}


def test_family_and_machine_exclude_each_other(ncomp):
    done = ncomp("codes", "G43", "--family", "fanuc", "--machine", "gantry")
    assert done.status == 2
    assert "the machine file states the family" in done.err
