"""A program that never ends comes back to a state that it has had."""

from __future__ import annotations

import copy

import msgspec


class Repetition(msgspec.Struct):
    """Finds a program that comes back to a state: it never ends. The state is kept at the powers of two (Brent)."""

    steps: int = 0
    kept: tuple[int, object] | None = None

    def found(self, at: int, state: object) -> bool:
        """Whether the program has been in this state before a block; called at every step back."""
        if self.kept == (at, state):
            return True
        self.steps += 1
        if self.steps & (self.steps - 1) == 0:
            self.kept = at, copy.deepcopy(state)
        return False
