"""Tools and wrappings of the programs that ncomp and LinuxCNC both run."""

import re

from clients.rs274 import Tool

NO_ADDRESS = r"(?![\d.])"
WRAPPINGS = {
    "a motion code beside G28": lambda text: re.sub(rf"(?m)^(?=.*G28)(.*?)G0{NO_ADDRESS} ?", r"\1", text),
    "clamping of a rotary axis": lambda text: re.sub(r"(?m)^M1[01](?=\r?$)", "", text),
    "an offset across the plane, of nothing": lambda text: text.replace(" K0.000", ""),
    "a dwell in a peck cycle": lambda text: re.sub(r"(?m)^(G83.*)P500\.", r"\1", text),
    "an end": lambda text: text if re.search(r"(?m)^(M30|M2)\b|^%", text) else text + "\nM2\n",
}
"""What LinuxCNC wants of the form of a program; none of it moves anything."""


def wrapped(text):
    for wrap in WRAPPINGS.values():
        text = wrap(text)
    return text


TOOLS = {1: Tool(80.5), 2: Tool(120.25), 3: Tool(0.0)}
