"""Print what LinuxCNC's interpreter makes of an NC program, at full double precision, as JSON lines.

    /usr/bin/python3 canon_dump.py PROGRAM TOOLS.tbl OFFSETS.var

Run by `rs274.py` under the Python that LinuxCNC's `gcode` module was built for, with a HOME of its own.
One line per canonical command, `[source line, command, [numbers]]`, lengths in mm and angles in degrees.
Exit 0, or 1 with `{"line": ..., "message": ...}` as the last line of the error output for a refused program.
"""

import ctypes
import json
import os
import sys
from pathlib import Path

sys.path.append("/usr/lib/python3/dist-packages")
import gcode  # LinuxCNC's interpreter as a module

MM = 25.4  # the module reports lengths in inches, whatever G20 and G21 say
N_POSE = 6  # x y z a b c; the module adds u v w
PLANES = {1: "xy", 2: "yz", 3: "xz"}
START = "G21 G90 G53 G0 X0 Y0 Z0 A0 B0 C0"  # left alone, the module starts at the zero of the work offset instead
NO_TOOL = (-1, *[0.0] * 12, 0)


def pose(values):
    """X y z a b c in mm and degrees."""
    return [v * MM for v in values[:3]] + list(values[3:N_POSE])


class Canon:
    """The canonical commands, called by the interpreter; those without a method here leave no trace."""

    def __init__(self, tools, parameter_file, output):
        self.output = output
        self.parameter_file = parameter_file  # read by the module
        self.tools = tools
        self.spindle = NO_TOOL
        self.line = 0
        self.started = False

    def __getattr__(self, name):
        if name.startswith("_"):
            raise AttributeError(name)
        return lambda *_: None

    def emit(self, command, values):
        """Print one command, but not the first rapid: that is START's."""
        if self.started or command != "rapid":
            print(json.dumps([self.line, command, values]), file=self.output)
        else:
            self.started = True

    def next_line(self, state):
        self.line = state.sequence_number

    def check_abort(self):
        return False

    def get_external_length_units(self):
        return 1.0  # the unit of the tool table and the offsets: mm

    def get_external_angular_units(self):
        return 1.0

    def get_axis_mask(self):
        return 0b000111111

    def get_block_delete(self):
        return False

    def get_tool(self, pocket):
        if pocket == 0:
            return self.spindle
        return self.tools[pocket - 1] if 0 < pocket <= len(self.tools) else NO_TOOL

    def change_tool(self, pocket):
        self.spindle = self.get_tool(pocket) if pocket > 0 else NO_TOOL

    def straight_traverse(self, *values):
        self.emit("rapid", pose(values))

    def straight_feed(self, *values):
        self.emit("line", pose(values))

    def straight_probe(self, *values):
        self.emit("probe", pose(values))

    def rigid_tap(self, *values):
        self.emit("tap", [v * MM for v in values[:3]])

    def arc_feed(self, *values):
        first, second, centre_first, centre_second, turns, normal, *rotary = values
        lengths = [v * MM for v in (first, second, centre_first, centre_second)]
        self.emit("arc", [*lengths, turns, normal * MM, *rotary[:3]])

    def set_plane(self, plane):
        self.emit("plane", PLANES[plane])

    def set_feed_rate(self, feed):
        self.emit("feed", [feed * MM])

    def tool_offset(self, *values):
        self.emit("tool_length", pose(values))

    def set_g5x_offset(self, _index, *values):
        self.emit("g5x", pose(values))

    def set_g92_offset(self, *values):
        self.emit("g92", pose(values))

    def set_xy_rotation(self, degrees):
        self.emit("rotation", [degrees])


def read_tools(table):
    """The tools of the table, each as the 14 numbers the module wants: T, nine offsets, D, two angles, orientation."""
    tools = []
    for line in Path(table).read_text(encoding="ascii").splitlines():
        word = {w[0]: float(w[1:]) for w in line.split()}
        tools.append((int(word["T"]), 0.0, 0.0, word["Z"], *[0.0] * 6, word["D"], 0.0, 0.0, 0))
    return tools


def make_tool_memory(table):
    """Make `$HOME/.tool.mmap` and load the tools there: without that file the first T word kills the process."""
    library = ctypes.CDLL("libtooldata.so.0")
    library["_Z13tooldata_initb"](ctypes.c_bool(False))
    library["_Z17tool_mmap_creatorPK13EMC_TOOL_STATi"](None, 0)
    library["_Z13tooldata_loadPKcPPc"](os.fsencode(table), None)


def main(program, table, offsets):
    """Interpret `program`, from machine zero in mm."""
    make_tool_memory(table)
    output = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)  # what the program itself prints goes to the error output
    canon = Canon(read_tools(table), offsets, output)
    try:
        result, _ = gcode.parse(program, canon, START, "G80")
        message = gcode.strerror(result) if result > gcode.MIN_ERROR else ""
    except Exception as error:  # the module raises what its callbacks raise, and its own for a missing file
        message = f"{type(error).__name__}: {error}"
    output.close()
    if message:
        print(json.dumps({"line": canon.line, "message": message}), file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
