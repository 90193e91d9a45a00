"""Modal G codes: plane, unit, distance and feed mode of later ISO blocks."""

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
    """The modes in force, and which of them the program has set."""

    notes: Notes
    mark_uncertain: Callable[[], None]
    """Called where a code sets a mode that earlier moves assumed: with another mode, the axes are elsewhere."""
    arc_absolute: bool
    plane: str = "XYZ"
    absolute: bool = True
    unit: float = 1.0
    timed: bool = False
    to_retract: bool | None = None
    """Canned cycles end at R (G99) and not at the level before (G98)."""
    not_programmed: dict[str, str] = field(default_factory=lambda: dict(_DEFAULTS))
    taken: set[str] = field(default_factory=set)
    """Modes that moves have assumed, as the program had not set them."""

    def take(self, code: float) -> bool:
        """Take over a code; False when it is none of these."""
        programmed = None
        if code in PLANES:
            self.plane, programmed = PLANES[code], "plane"
        elif code in UNITS:
            self.unit, programmed = UNITS[code], "unit"
        elif code in DISTANCES:
            self.absolute, programmed = code == 90.0, "distance"
        elif code in CENTRE_DISTANCES:
            self.arc_absolute = code == 90.1
        elif code in FEED_MODES:
            self.timed = code == INVERSE_TIME
        elif code in (RETURN_TO_LEVEL, RETURN_TO_R):
            self.to_retract = code == RETURN_TO_R
        else:
            return False
        if programmed is not None:
            self.not_programmed.pop(programmed, None)
            if programmed in self.taken and code in (21.0, 90.0):
                self.mark_uncertain()
            self.taken.discard(programmed)
        return True

    def note_not_programmed(self, line: int, kind: Kind) -> None:
        """Note the assumptions of a move: modes that the program has not given."""
        for what in ("unit", "distance", "plane") if kind is Kind.ARC else ("unit", "distance"):
            if what in self.not_programmed:
                self.notes.add(self.not_programmed.pop(what), line)
                self.taken.add(what)
