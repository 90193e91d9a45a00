"""Notes: assumptions of a run, each once, with its first line and their number."""

from __future__ import annotations

import msgspec

from postproc.text.line_numbers import shown


class Notes(msgspec.Struct):
    """Collects notes for the user of conditions that do not stop the run."""

    first: dict[str, int] = msgspec.field(default_factory=dict)
    count: dict[str, int] = msgspec.field(default_factory=dict)

    def add(self, text: str, line: int, times: int = 1) -> None:
        """Note `text` for a block at `line`, the first of so many."""
        self.first.setdefault(text, line)
        self.count[text] = self.count.get(text, 0) + times

    def texts(self) -> list[str]:
        """Each note with its first line and count, in the order of lines."""
        return [
            f"{text} (line {shown(line)}{f', {self.count[text]} times' if self.count[text] > 1 else ''})"
            for line, text in sorted((line, text) for text, line in self.first.items())
        ]
