"""Mistakes in machine files."""

from __future__ import annotations

from tests.mistakes.mistake import Mistake, change


def entry(made: str, old: str, new: str, line: int | None, cause: str, cure: str) -> Mistake:
    """A mistake in a line of the machine file; None for an entry that is nowhere."""
    place = "machine file mill.toml: " if line is None else f"machine file mill.toml:{line}: "
    return Mistake(made, "machines mill.toml", place, cause, cure, (change("mill.toml", old, new),))


MISTAKES = (
    entry("entry misspelled", "travel = [-110", "travvel = [-110", 11, "axes.B.travvel is not known", "did you mean 'travel'?"),
    entry("text without quotes", 'name = "mill"', "name = mill", 1, "Invalid value", "write texts in quotes"),
    entry("chain without the bed", '"w C B b X', '"w C B X', 3, "is not of the form 'w ... b ... t'", "e.g. 'w C B b X Y Z t'"),
    entry("chain in small letters", '"w C B b X Y Z t"', '"w c b b x y z t"', 3, "is not of the form", "e.g. 'w C B b X Y Z t'"),
    entry("axis without a table", "[axes.Y]\ntravel = [-225, 225]\n", "", 3, "its axis Y has no table", "write [axes.Y] with travel"),
    entry("table without an axis", "[axes.Y]", "[axes.A]\ntravel = [0, 1]\n\n[axes.Y]", 16, "axes.A is not in the chain", "write A into the chain"),
    entry("travel the wrong way round", "[-250, 250]", "[250, -250]", 14, "axis X: travel [250.0, -250.0]", "from a lower to a higher position"),
    entry("decimal commas", "[-250, 250]", "[-250,0, 250,0]", 14, "expected a list of 2 entries, not of 4", "decimal point as '.'"),
    entry("travel as one number", "[-250, 250]", "250", 14, "not a whole number", "axes.X.travel: expected a list in [ ]"),
    entry("travel as text", "[-250, 250]", '"-250..250"', 14, "not a text in quotes", "expected a list in [ ]"),
    entry("rotary axis without its point", "[axes.B]\npoint = [0, 0, 154.996]", "[axes.B]", 9, "axes.B: a rotary axis needs its point", "a point on its axis of rotation"),
    entry("point of two numbers", "[axes.B]\npoint = [0, 0, 154.996]", "[axes.B]\npoint = [0, 154.996]", 10, "axes.B.point", "expected a list of 3 entries"),
    entry("direction of no length", "[-250, 250]", "[-250, 250]\ndirection = [0, 0, 0]", 15, "is no direction", "three numbers, not all of them 0"),
    entry("home beyond the travel", "home = 400", "home = 4000", 21, "home 4000.0 is outside its travel", "expected a position within it"),
    entry("work offset of an axis that is not there", "X = -12.5", "U = -12.5", 27, "no axis U in the chain", "its axes are B, C, X, Y, Z"),
    entry("tool length in quotes", "5 = 96.3", '5 = "96.3"', 30, "not a text in quotes", "tools.5: expected a number"),
    entry("control that is not known", '"fanuc"', '"okuma"', 24, "not 'okuma'", "control.family: expected 'any', 'fanuc', 'linuxcnc', 'grbl' or 'mach3'"),
    entry("setting that is not known", "[control]", "[control]\nincremnt = 0.01", 24, "control.incremnt is not known", "did you mean 'increment'?"),
    entry("two tables of one axis", "[axes.Y]", "[axes.X]", 16, "twice", "a table begins with its name in brackets, once"),
    entry("bracket forgotten", "[axes.Y]", "[axes.Y", 16, "Expected ']'", "its name in brackets"),
    entry("name forgotten", 'name = "mill"\n', "", None, "name is missing", "write name = ..."),
    entry("table misspelled", "[axes.X]", "[axis.X]", 13, "axis is not known", "did you mean 'axes'?"),
    entry("entry of the report's head misspelled", "[control]", '[report]\noperater = "A"\n\n[control]', 24, "report.operater is not known", "did you mean 'operator'?"),
    entry("name with a slash", '"mill"', '"hall 3/mill"', 1, "name: 'hall 3/mill' cannot be the name of a file", "write letters, digits"),
    entry("name left empty", '"mill"', '""', 1, "name: '' cannot be the name of a file", "write letters, digits"),
    Mistake("program in place of the machine file", "machines in.nc", "machine file in.nc", "this is an NC program", "no machine file"),
    Mistake("machine file misspelled", "machines mil.toml", "machine file mil.toml", "No such file", "did you mean 'mill.toml'?"),
    Mistake("saved in Latin-1", "machines mill.toml", "machine file mill.toml", "not UTF-8 text", "save it as UTF-8", (("mill.toml", 'name = "Fr\xe4se"'.encode("latin-1")),)),
    entry("two axes of one letter", '"w C B b X Y Z t"', '"w C B b X X Y Z t"', 3, "axis X appears twice", "chain 'w C B b X X Y Z t'"),
    entry("home that is no number", "home = 400", "home = nan", 21, "home nan is outside its travel", "expected a position within it"),
    entry("date as a tool length", "5 = 96.3", "5 = 2026-11-03", 30, "tools.5", "expected a number, not date"),
    entry("tool with a point in its name", "5 = 96.3", "5.5 = 96.3", 30, "not a table", "write a name with a point in it in quotes"),
    Mistake("brackets without end", "machines mill.toml", "machine file mill.toml", "nested too deeply", "delete the surplus brackets", (("mill.toml", f"a = {'[' * 3000}{']' * 3000}\n"),)),
    Mistake("zero byte of a damaged disk", "machines mill.toml", "machine file mill.toml:2", "Illegal character", "expected name = value", (change("mill.toml", "Trunnion", "Trun\0nion"),)),
)  # fmt: skip
