"""Modal G codes that say how the words of later ISO blocks are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from postproc.control.codes import DISTANCES, INVERSE_TIME, PLANES
from postproc.iso.codes import CENTRE_DISTANCES, FEED_MODES, RETURN_TO_LEVEL, RETURN_TO_R, UNITS
from postproc.motion.moves import Kind
from postproc.text.notes import Notes

_DEFAULTS = {
    "unit": "no G20 or G21 before it: coordinates taken in mm",
    "distance": "no G90 or G91 before it: coordinates taken as absolute",
    "plane": "no G17, G18 or G19 before it: arcs taken in X Y",
}


@dataclass
class Modes:
    """The modes in force, and which of them the program has said."""

    notes: Notes
    doubt: Callable[[], None]
    """Called where a code says what moves have been read by unsaid: if it was another before, axes stand elsewhere."""
    arc_absolute: bool
    plane: str = "XYZ"
    absolute: bool = True
    unit: float = 1.0
    timed: bool = False
    to_retract: bool | None = None
    """Canned cycles end at R (G99) and not at the level before (G98)."""
    unsaid: dict[str, str] = field(default_factory=lambda: dict(_DEFAULTS))
    taken: set[str] = field(default_factory=set)
    """What the program has left unsaid and moves have been read by."""

    def take(self, code: float) -> bool:
        """Take over a code; False when it is none of these."""
        said = None
        if code in PLANES:
            self.plane, said = PLANES[code], "plane"
        elif code in UNITS:
            self.unit, said = UNITS[code], "unit"
        elif code in DISTANCES:
            self.absolute, said = code == 90.0, "distance"
        elif code in CENTRE_DISTANCES:
            self.arc_absolute = code == 90.1
        elif code in FEED_MODES:
            self.timed = code == INVERSE_TIME
        elif code in (RETURN_TO_LEVEL, RETURN_TO_R):
            self.to_retract = code == RETURN_TO_R
        else:
            return False
        if said is not None:
            self.unsaid.pop(said, None)
            if said in self.taken and code in (21.0, 90.0):
                self.doubt()
            self.taken.discard(said)
        return True

    def note_unsaid(self, line: int, kind: Kind) -> None:
        """Note the assumptions of a move: modes that the program has not given."""
        for what in ("unit", "distance", "plane") if kind is Kind.ARC else ("unit", "distance"):
            if what in self.unsaid:
                self.notes.add(self.unsaid.pop(what), line)
                self.taken.add(what)
