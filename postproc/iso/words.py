"""Words of one ISO block: sorted, checked, given to the codes that use them, and read as numbers."""

from __future__ import annotations

from postproc.control import words
from postproc.control.codes import AXES, DWELL, MOTION, SKIPPABLE_M
from postproc.control.words import refuse_two_of_a_group
from postproc.iso.codes import (
    COORDINATE_CHANGES,
    CORNER_WORDS,
    CYCLES,
    DATA,
    ENDS,
    FINE_BORING,
    GROUPS,
    LENGTH_CODES,
    MEANINGFUL,
    NAMING,
    PATH_MODES,
    REFUSED_G,
    TOOL_IS,
    TURNING_CYCLES,
)
from postproc.iso.families import ANY, GRBL, IN_MACHINE_FRAME, LINUXCNC, MACH3, SELECT_KINEMATICS
from postproc.iso.reading.blocks import WORDS
from postproc.motion.arcs import CENTRES
from postproc.motion.moves import Kind
from postproc.text.block import Block, Refusal


class Content(words.Content):
    """The words of one block, sorted; `names` are words that belong to M functions, and those behind a comma."""

    @property
    def ends(self) -> list[float]:
        """The codes that end a rotation or a preset, whatever else the block contains, in the order of execution."""
        if self.axes or not self.other.keys().isdisjoint("IJKRPL"):
            return []
        return [code for code in ENDS if code in self.g]

    @property
    def moves(self) -> bool:
        """True where the block may have a position."""
        return bool(self.axes) or not self.other.keys().isdisjoint("IJKR")


def sort_words(block: Block) -> Content:
    """The content of a block; Refusal for one address twice."""
    content, done = Content(block), ""
    for i, word in enumerate(block.words):
        address = word[0]
        if address == "G":
            content.g.append(word[1] or 0.0)
        elif address == "M":
            content.m.append(word[1] or 0.0)
        elif address in CORNER_WORDS:
            if address in content.names:
                raise block.refuse(f"the block has two {address} words: write one of them")
            content.names[address] = i
        elif address in done:
            raise block.refuse(f"the block has two {address} words: write one of them")
        else:
            done += address
            if address in AXES:
                content.axes.append(i)
            else:
                content.other[address] = i
    return content


def check_content(content: Content, begun: bool, family: str) -> None:
    """Refuse words that controls read differently; `begun`: the program has words before this block."""
    block, g, other = content.block, content.g, content.other
    _refuse_turning(content)
    if block.skippable and not _may_be_skipped(content):
        raise block.refuse_skip()
    if "O" in other and begun:
        raise block.refuse("a second program in one file is not corrected: write it into a file of its own")
    if ";" in block.text and family not in (LINUXCNC, GRBL):
        _check_line_end(block)
    if "H" in other and LENGTH_CODES.isdisjoint(g) and REFUSED_G.keys().isdisjoint(g):
        raise block.refuse(
            "H without G43: some controls take the new length at once, others do not. Write G43 in this block"
        )
    if len(g) > 1:
        naming = NAMING - {DWELL} if family in (LINUXCNC, MACH3) else NAMING
        if content.axes and not naming.isdisjoint(g) and not (MOTION.keys() | CYCLES).isdisjoint(g):
            raise block.refuse("two G codes of the block can use its coordinates: write them in two blocks")
        alone = [code for code in g if code not in content.ends]
        refuse_two_of_a_group(block, alone, GROUPS)


def _refuse_turning(content: Content) -> None:
    """Refuse the cycles of a lathe. Fine boring and pecking of a mill have P and Q as well, but with X, Y or Z."""
    for code in content.g:
        if code not in TURNING_CYCLES:
            continue
        addresses = {word.address for word in content.block.words}
        forms = [form for form in TURNING_CYCLES[code] if addresses.issuperset(form)]
        if forms and (code not in (*CYCLES, FINE_BORING) or addresses.isdisjoint("XYZ")):
            raise content.refuse(
                f"G{code:g} with {' and '.join(forms[0])} is a cycle of a lathe: this is a turning program, which "
                "ncomp does not correct. Its X is a diameter, the tool does not move in Y, and the control makes the "
                "cuts of the cycle itself, so that the program does not contain their moves. Use ncomp for the "
                "programs of a milling machine or a machining centre"
            )


def _may_be_skipped(content: Content) -> bool:
    """Whether no other block depends on this one: M functions that move nothing, and a dwell."""
    if content.moves or "T" in content.other or not SKIPPABLE_M.issuperset(content.m):
        return False
    return not content.g or content.g == [DWELL] or PATH_MODES.issuperset(content.g)


def _check_line_end(block: Block) -> None:
    """Refuse words after a semicolon after words: where a semicolon ends a block, they are the next block."""
    _, mark, rest = block.text[block.words[-1].end :].partition(";")
    if mark and WORDS.fullmatch(rest.rstrip("\r\n")) and not MEANINGFUL.isdisjoint(rest.upper()):
        raise block.refuse(
            "words after a semicolon are a comment on some controls and the next block on others: write "
            "them in parentheses or in a block of their own"
        )


def check_speed(content: Content, code: float) -> None:
    """G5.1 Q and G5 P switch a fast path on or off; with anything else they are splines."""
    if ("Q" if code == 5.1 else "P") not in content.other:
        raise content.refuse(f"G{code:g} without {'Q' if code == 5.1 else 'P'}: splines are not corrected")
    if code == 5.0 and content.moves:
        raise content.refuse("splines are not corrected")


# ---- words that codes of the block use: the time of a dwell, the angle of an oriented stop

ORIENTED_STOP, WAIT = 19.0, 66.0
OUTPUTS: dict[float, str] = {
    TOOL_IS: "Q",
    **dict.fromkeys((62.0, 63.0, 64.0, 65.0), "P"),
    WAIT: "ELPQ",
    **dict.fromkeys((67.0, 68.0), "EQ"),
}
"""M functions of LinuxCNC for the tool, outputs and inputs, with their words."""
TAKEN_BY_M = {ORIENTED_STOP: "PQR", **OUTPUTS}
TAKEN_BY_G = {
    SELECT_KINEMATICS: "P",
    DWELL: "P",
    5.0: "P",
    5.1: "Q",
    DATA: "LPQR",
    30.0: "P",
    51.0: "P",
    64.0: "PQ",
    54.1: "P",
    154.0: "P",
}
CLAIMING = COORDINATE_CHANGES | {28.0, 30.0}
"""Codes that take the axis words of their block, so that a modal motion does not act in it."""
ARC_WORDS, CYCLE_WORDS = CENTRES + "PR", CENTRES + "KLPQR"
DWELL_TIMES = "XUFSK"
"""Words for the time of a dwell on some controls, instead of P; LinuxCNC and similar controls refuse these."""
DIFFERS = 'write family = "fanuc" or "linuxcnc" in the machine file'


def decided_by_family(content: Content, family: str, reason: str, **own: str) -> Refusal:
    """The exception for what controls read differently: for a stated family its own reason, else the entry to write."""
    cure = DIFFERS if family == ANY else f"what {family} does is not known to ncomp: write it in another form"
    return content.refuse(own.get(family, f"{reason}; {cure}"))


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
    if family == LINUXCNC:
        content.g[:] = [IN_MACHINE_FRAME.get(code, code) for code in content.g]
    takers = [(f"G{code:g}", TAKEN_BY_G[code]) for code in content.g if code in TAKEN_BY_G]
    takers += [(f"M{code:g}", TAKEN_BY_M[code]) for code in content.m if code in TAKEN_BY_M]
    if not takers:
        return
    takers.append(("the motion", motion_words(content, motion)))
    for address in content.other:
        names = [name for name, letters in takers if address in letters]
        if len(names) > 1:
            raise content.refuse(
                f"{' and '.join(names)} can both use the {address} of this block: write them in two blocks"
            )
    for code in content.m:
        waits = code == WAIT and family == ANY and "L" in content.other
        if code == ORIENTED_STOP or waits or (code in OUTPUTS and family in (LINUXCNC, GRBL)):
            for address in content.other.keys() & set(TAKEN_BY_M[code]):
                content.names[address] = content.other.pop(address)


def dwells_alone(content: Content, family: str) -> bool:
    """Whether a G4 block only waits; False where its axis words move, as on LinuxCNC. Refusal where controls differ."""
    other, times = content.other, [content.block.words[i].address for i in content.axes]
    strange = sorted(other.keys() & {"I", "J", "R", "Q", "L", "D", "E"})
    if strange:
        raise content.refuse(f"the effect of {strange[0]} in a G4 block depends on the control: leave it out")
    if "P" in other and content.axes:
        if family in (LINUXCNC, MACH3):
            return False
        raise decided_by_family(
            content,
            family,
            "axis words with G4 P are a move on LinuxCNC and Mach3, and other controls refuse them",
            fanuc="FANUC reads no axis words beside the P of G4: write the move in a block of its own",
        )
    if "P" not in other and (len(times) > 1 or not set(times) <= set(DWELL_TIMES)):
        raise content.refuse(
            "G4 has axis words that are no dwell time, and some controls move there: write the move in a "
            "block of its own"
        )
    return True
