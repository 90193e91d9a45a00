"""`ncomp measure`: questions and answers in a pipe, the next length, mistakes, and the file that it writes."""

import json
from pathlib import Path

import pytest

import ncomp
from benchmarks import lengths as benchmark
from kinematics.error_model.model import read_model


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "router.toml").write_text(benchmark.MACHINE)
    return tmp_path


def asked(command, folder: Path, answers: list[str], *options: str) -> tuple[int, list[str], str]:
    """Exit status, the questions, and all that was printed, by a user who gives these answers in a pipe."""
    given = "--size", "600,600", "--u", "0.25"
    files = "-m", folder / "router.toml", "-o", folder / "lengths.csv"
    stdin = "".join(f"{answer}\n" for answer in answers).encode()
    done = command("measure", *files, *(options or given), stdin=stdin)
    questions = [line.partition(", about")[0] for line in done.err.splitlines() if line.startswith("From ")]
    return done.status, questions, done.err


def test_the_diagonals_come_first_and_each_answer_is_judged(command, folder):
    status, questions, printed = asked(command, folder, ["851", "846.5", "599.5", "601", "600", "601"])
    assert status == 0, printed
    assert questions[:2] == ["From A to C", "From B to D"]
    assert len(questions) == len(set(questions)) == 6
    assert "A: X 100 Y 100" in " ".join(printed.split())
    assert "Y leans to +X by 1.59" in printed
    assert "scale of X: not known yet" in printed
    text = (folder / "lengths.csv").read_text()
    assert "# instrument: lengths" in text
    assert "AC,100,100,700,700,851" in text
    fit = (
        "fit",
        folder / "lengths.csv",
        "-m",
        folder / "router.toml",
        "-o",
        folder / "cal.json",
        "--json",
        folder / "f.json",
    )
    assert command(*fit).status == 0
    assert json.loads((folder / "f.json").read_text())["n_observations"] == 12


def test_an_empty_answer_ends_and_what_was_given_is_written(command, folder):
    status, questions, _ = asked(command, folder, ["851", "846.5", ""])
    assert status == 0
    assert len(questions) == 3
    assert len((folder / "lengths.csv").read_text().splitlines()) == 6


def test_answers_that_cannot_be_used_are_asked_again(command, folder):
    status, questions, printed = asked(
        command, folder, ["85l", "850,5", "-5", "90", "851", "846.5", "-", "601", "drop XX", "drop AC"]
    )
    assert status == 0
    assert questions[:5] == ["From A to C"] * 5
    assert "'85l' is not a number" in printed
    assert "'850,5' is not a number; write the decimal point as '.'" in printed
    assert "column length_mm: -5 is not above 0" in printed
    assert "AC: 90 mm between positions 848.53 mm apart" in printed
    assert "XX: there is AC, BD" in printed
    rows = [line.partition(",")[0] for line in (folder / "lengths.csv").read_text().splitlines()]
    assert "AC" not in rows
    assert "BD" in rows
    skipped = questions[6].removeprefix("From ").replace(" to ", "")
    assert skipped not in rows
    assert questions[-1] == "From A to C"


def test_a_length_that_contradicts_the_others_is_asked_again(command, folder):
    _, questions, printed = asked(command, folder, ["851", "846.5", "600", "612", "600"])
    assert "contradict" in printed
    assert questions[3] == questions[4]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--size", "900,600"), "--size 900: the side along X is above 0, and at most 800 mm"),
        (("--size", "0,600"), "--size 0: the side along X is above 0"),
        (("--size", "6"), "--size 6"),
    ],
)
def test_sides_that_the_machine_does_not_have_are_refused(command, folder, options, reason):
    status, questions, printed = asked(command, folder, ["1"], *options)
    assert status == 2
    assert questions == []
    assert reason in " ".join(printed.split())
    assert not (folder / "lengths.csv").exists()


def test_a_dial_gauge_shows_the_backlash_of_both_axes(command, folder):
    """X stands 0.12 mm too far when it comes from above, and Y 0.02 mm."""
    answers = ["851", "846.5", "599.5", "", "0.12", "0.12", "0.02", "0.02"]
    options = "--size", "600,600", "--u", "0.25", "--gauge-um", "5"
    status, _, printed = asked(command, folder, answers, *options)
    assert status == 0, printed
    assert "Move X to 399, then up to 400, and set the dial to zero" in printed
    assert "backlash of X: 0.120" in printed
    assert "backlash of Y: 0.020" in printed
    fit = "fit", folder / "lengths.csv", "-m", folder / "router.toml", "-o", folder / "cal.json"
    assert command(*fit).status == 0
    effects = {e.name: e for e in read_model(folder / "cal.json", ncomp.load_machine(folder / "router.toml")).effects}
    assert effects["backlash X"].parameters[0] == pytest.approx(120.0, abs=3.0)
    assert effects["backlash Y"].parameters[0] == pytest.approx(20.0, abs=3.0)


def test_without_an_answer_nothing_is_written(command, folder):
    status, _, printed = asked(command, folder, [])
    assert status == 2
    assert "no length was given: nothing is written" in printed
    assert not (folder / "lengths.csv").exists()
