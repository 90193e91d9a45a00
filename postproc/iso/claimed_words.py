"""Words that codes of an ISO block take for themselves: the time of a dwell, the angle of an oriented stop."""

from __future__ import annotations

from postproc.iso.codes import CYCLES, DATA, DWELL, MOTION, PLACING, TOOL_IS
from postproc.iso.words import Content
from postproc.motion.arcs import CENTRES
from postproc.motion.moves import Kind

ORIENTED_STOP, WAIT = 19.0, 66.0
OUTPUTS: dict[float, str] = {
    TOOL_IS: "Q",
    **dict.fromkeys((62.0, 63.0, 64.0, 65.0), "P"),
    WAIT: "ELPQ",
    **dict.fromkeys((67.0, 68.0), "EQ"),
}
"""M functions of LinuxCNC for the tool, outputs and inputs, with their words."""
TAKEN_BY_M = {ORIENTED_STOP: "PQR", **OUTPUTS}
TAKEN_BY_G = {DWELL: "P", 5.0: "P", 5.1: "Q", DATA: "LPQR", 30.0: "P", 51.0: "P", 64.0: "PQ", 54.1: "P", 154.0: "P"}
CLAIMING = PLACING | {28.0, 30.0}
"""Codes that take the axis words of their block, so that a modal motion does not act in it."""
ARC_WORDS, CYCLE_WORDS = CENTRES + "PR", CENTRES + "KLPQR"
DWELL_TIMES = "XUFSK"
"""Words for the time of a dwell on some controls, instead of P; LinuxCNC and similar controls refuse these."""
DIFFERS = 'write family = "fanuc" or "linuxcnc" in the machine file'


def motion_words(content: Content, motion: float | None) -> str:
    """The words that the motion takes in this block; `motion`: the code in force before it."""
    motion = next((code for code in content.g if code in MOTION or code in CYCLES), motion)
    if motion not in content.g and not CLAIMING.isdisjoint(content.g):
        return ""  # the axis words belong to the other code, so that the block does not move
    if motion in CYCLES:
        return CYCLE_WORDS if content.axes else "R"
    return ARC_WORDS if content.axes and motion in MOTION and MOTION[motion] is Kind.ARC else ""


def take_own_words(content: Content, motion: float | None, family: str) -> None:
    """Take the words of M functions out of a block; Refusal for a word that two codes may take."""
    takers = [(f"G{code:g}", TAKEN_BY_G[code]) for code in content.g if code in TAKEN_BY_G]
    takers += [(f"M{code:g}", TAKEN_BY_M[code]) for code in content.m if code in TAKEN_BY_M]
    if not takers:
        return
    takers.append(("its motion", motion_words(content, motion)))
    for address in content.other:
        names = [name for name, letters in takers if address in letters]
        if len(names) > 1:
            raise content.refuse(f"{address} in one block with {' and '.join(names)}, which may both take it")
    for code in content.m:
        if code == ORIENTED_STOP or (code in OUTPUTS and family == "linuxcnc"):
            for address in content.other.keys() & set(TAKEN_BY_M[code]):
                content.own[address] = content.other.pop(address)


def dwells_alone(content: Content, family: str) -> bool:
    """Whether a G4 block only waits; False where its axis words move, as on LinuxCNC. Refusal where controls differ."""
    other, times = content.other, [content.block.words[i].address for i in content.axes]
    strange = sorted(other.keys() & {"I", "J", "R", "Q", "L", "D", "E"})
    if strange:
        raise content.refuse(f"{strange[0]} beside G4: its effect depends on the control")
    if "P" in other and content.axes:
        if family == "linuxcnc":
            return False
        raise content.refuse(f"axis words beside G4 P: a move on LinuxCNC and Mach3, refused by others; {DIFFERS}")
    if "P" not in other and (len(times) > 1 or not set(times) <= set(DWELL_TIMES)):
        raise content.refuse("a dwell with axis words that are no time: some controls move there")
    return True
