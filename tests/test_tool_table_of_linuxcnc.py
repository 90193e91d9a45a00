"""LinuxCNC's tool table, read as LinuxCNC's interpreter reads it."""

import re
import subprocess
from pathlib import Path

import pytest

from kinematics.user_error import UserError
from postproc.control_data.tool_tables import read_tool_table

SHIPPED = Path("/usr/share/doc/linuxcnc/examples/sample-configs")
LENGTH = re.compile(r"USE_TOOL_LENGTH_OFFSET\(\S+ \S+ (\S+),")


def lengths(table, tools):
    """The lengths of tools, mm, by rs274, whose machine is in inches; None for a tool that the table does not have."""
    found = {}
    for tool in tools:
        program = table.with_name("t.ngc")
        program.write_text(f"G21 G90\nT{tool} M6\nG43 H{tool}\nM2\n")
        done = subprocess.run(
            ["rs274", "-g", "-t", table, program], capture_output=True, text=True, cwd=table.parent,
            env={"HOME": str(table.parent), "PATH": "/usr/bin:/bin"}, timeout=60, check=False,
        )  # fmt: skip
        length = LENGTH.search(done.stdout)
        found[tool] = None if length is None else float(length[1])
    return found


READ = {
    "no Z": "T1 P1 D8\n",
    "no tool": "T0 P0 ;no tool\nT1 P1 Z3.5\n",
    "radius only": "T1 P1 D0.5\nT2 P2 Z-1.25 D1 ;x\n",
    "turning": "T1 P1 D0.1 I+85.0 J+25.0 Q2 ;\n",
    "Q with decimals": "T1 P1 X0.0 Y0.0 Z-12.7129 D1.0 I0.0 J0.0 Q0.0 ;roughing\n",
    "other order, small letters": "  z3.5 t1 p1\n",
    "exponent": "T1 P1 Z1e1\n",
    "leading zero": "T01 P1 Z+.5\n",
    "comments and empty lines": ";head\n\n   \nT1 P1 Z3.5;x\n",
    "CR LF": "T1 P1 Z3.5\r\nT2 P2 Z4 ;x\r\n",
    "a line that names no tool": "POCKET LENGTH\n-----\nT1 P1 Z3.5\n",
    "one tool without pocket": "T1 Z3.5\nT2 P2 Z4\n",
}


@pytest.mark.parametrize("text", READ.values(), ids=READ)
@pytest.mark.usefixtures("linuxcnc")
def test_lengths_are_those_of_rs274(tmp_path, text):
    table = tmp_path / "tool.tbl"
    table.write_text(text, newline="")
    found = read_tool_table(table, "inch").tools
    assert found == pytest.approx(lengths(table, found), abs=1e-4)


REFUSED = {
    "a length twice": ("T4 P4 Z3.0 Z3.5 D8\n", "4", 3.5, "has Z twice, of which LinuxCNC takes the last"),
    "a space behind the letter": ("T4 P4 Z 4.0\n", "4", None, "is not a tool entry"),
    "an unknown word": ("T4 P4 Z3.0 M5\n", "4", None, "is not a tool entry"),
    "tabs": ("T4\tP4\tZ3.5\n", "4", 0.0, "ignores the words behind a tab"),
    "words without a space": ("T4 P4 Z3.0X5\n", "4", 3.0, "is not a tool entry"),
    "a decimal comma": ("T4 P4 Z3,5\n", "4", 3.0, "write the decimal point as '.'"),
    "a space before CR LF": ("T4 P4 Z3.5 \r\n", "4", None, "LinuxCNC skips the line"),
    "two tools without pocket": ("T4 Z3.5\nT5 Z4\n", "4", None, "LinuxCNC keeps only the last of such tools"),
    "a tool twice": ("T4 P4 T5 Z3\n", "4", None, "has T twice"),
}


@pytest.mark.parametrize(("text", "tool", "length", "said"), REFUSED.values(), ids=REFUSED)
@pytest.mark.usefixtures("linuxcnc")
def test_lines_that_linuxcnc_reads_in_part_are_refused(tmp_path, text, tool, length, said):
    """With what rs274 makes of them."""
    table = tmp_path / "tool.tbl"
    table.write_text(text, newline="")
    with pytest.raises(UserError, match=re.escape(said)) as refused:
        read_tool_table(table, "inch")
    assert f"{table}:" in str(refused.value)
    assert lengths(table, [tool])[tool] == (None if length is None else pytest.approx(25.4 * length, abs=1e-3))


@pytest.mark.skipif(not SHIPPED.exists(), reason="LinuxCNC is not installed")
def test_shipped_tables():
    """All but those with offsets sideways, a table with a tool twice, and one of another layout."""
    paths = [path for path in sorted(SHIPPED.rglob("*.tbl")) if path.is_file()]
    refused = {}
    for path in paths:
        try:
            read_tool_table(path, "mm")
        except UserError as fault:
            refused[path.name] = re.sub(r".*:\d+: ", "", str(fault))
    other = [why for why in refused.values() if "is not supported" not in why and "in the table twice" not in why]
    assert len(paths) > 80
    assert [why for why in other if not why.startswith("'TOOLNO POCKET")] == []
