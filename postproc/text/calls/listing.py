"""The blocks of a program and of the files that it calls, with the labels by which jumps and calls find them."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

from postproc.text.block import Block
from postproc.text.blocks import PlainRun
from postproc.text.calls.called_files import shown_name
from postproc.text.expressions import NotKnown
from postproc.text.statements import Rerun


class Passed(Exception):
    """Raised for a call that is not followed: the user states that the contour is independent of it."""


class Files(Protocol):
    """The files of called programs."""

    @property
    def runs(self) -> Mapping[int, PlainRun]:
        """Runs of plain lines by the index of their first block."""

    @property
    def end(self) -> str:
        """The cure for a subprogram without an end."""

    def first_block(self, name: str, at: int) -> int:
        """Index of the first block of the file of a program that is called by the block `at`.

        The blocks of a new file are added, behind one that stands for the end of the blocks before them. NotKnown for
        a program without a file, and for one that cannot be read.
        """

    def refuse_beside(self, name: str, inside: int) -> None:
        """NotKnown if a program has a file of its own, and a beginning at the block `inside` of another file."""

    def name(self, at: int) -> str:
        """The name of the file of a block."""


class OneFile:
    """No file but that of the main program."""

    end = ""
    runs: Mapping[int, PlainRun] = MappingProxyType({})

    def first_block(self, name: str, _: int) -> int:
        """NotKnown for every program."""
        raise NotKnown(f"the file has no subprogram {shown_name(name)}: write it into the file once")

    def refuse_beside(self, _: str, __: int) -> None:
        """No file is beside."""

    def name(self, _: int) -> str:
        """Nothing."""
        return ""


class Listing:
    """The blocks of all files, one behind the other: the main program is the first."""

    def __init__(
        self,
        blocks: Sequence[Block],
        labels: Callable[[Block], Iterable[str]],
        begins: Callable[[Block], bool],
        files: Files,
        taken: Callable[[int], None],
    ) -> None:
        """`begins`: true for the first block of a program; `taken`: called with the first block of each called file."""
        self.blocks, self.files = blocks, files
        self._labels, self._begins, self._taken = labels, begins, taken
        self._programs: list[int] = []
        """For every block the program of a file to which it belongs."""
        self._labelled: dict[str, list[int]] = {}
        self._firsts: list[int] = []
        """The first block of each file."""
        self._called: dict[tuple[str, int, bool, bool], int] = {}
        """First blocks of subprograms by their names and calls, as long as no further file is called."""
        self.ends: set[int] = set()
        """Blocks that stand for the end of a file."""
        self._take(0)

    @property
    def several(self) -> bool:
        """True if the program has called another file."""
        return bool(self.ends)

    def at_end(self, at: int) -> bool:
        """True behind the main program; Refusal behind a subprogram without a statement that ends it."""
        if at < len(self.blocks) and at not in self.ends:
            return False
        if self.ends and at <= len(self.blocks) and self._file(at) > 0:
            raise self.blocks[at - 1].refuse(f"the subprogram has no end: {self.files.end}")
        return True

    def plain(self, at: int, last: int) -> PlainRun | None:
        """The plain lines from a block on; None for a block that is read by itself.

        last: last block of the part of the program that is run again, if it is behind.
        """
        run = self.files.runs.get(at)
        return run if run is None or not at <= last < at + len(run) - 1 else run.part(0, last + 1 - at)

    def labelled(self, name: str, at: int) -> list[int]:
        """The blocks of a label in the program that a block belongs to."""
        return [i for i in self._labelled.get(name, []) if self._programs[i] == self._programs[at]]

    def only(self, name: str, at: int) -> int:
        """The only block of a label in the program that a block belongs to; NotKnown for another number of them."""
        found = self.labelled(name, at)
        if len(found) != 1:
            raise NotKnown(f"the program has {len(found) or 'no'} blocks with the label {name}: write it once")
        return found[0]

    def part(self, step: Rerun, at: int) -> tuple[int, int]:
        """The first and the last block of the part that the block `at` runs again; NotKnown where labels do not tell.

        Without a second label it ends with the end label behind the first, or before `at`.
        """
        first, last = step.first, step.last
        firsts = self.labelled(first, at)
        if len(firsts) == 1 and step.end_label:
            ends = [end for end in self.labelled(step.end_label, at) if end >= firsts[0]]
            if ends and firsts[0] < at < ends[0] and not last:
                raise NotKnown(
                    f"the repetition stands between {first} and {step.end_label}, which both may end it: write it with "
                    "two labels"
                )
            if ends and not last:
                return firsts[0], ends[0]
        if len(firsts) != 1 or (firsts[0] >= at and not last):
            raise NotKnown(f"the repetition needs exactly one label {first} before it")
        if not last:
            return firsts[0], at - 1
        lasts = self.labelled(last, at)
        if len(lasts) != 1 or lasts[0] < firsts[0]:
            raise NotKnown(f"the repetition needs exactly one label {last} after {first}")
        return firsts[0], lasts[0]

    def first_block(self, name: str, at: int, *, local: bool, begun: bool) -> int:
        """The first block of a subprogram: of the file of the call, of the main program, or of another file.

        local: in the file of the call; begun: the subprogram must have a beginning of its own. NotKnown for none.
        """
        call = name, self._file(at), local, begun
        if call not in self._called:
            files = len(self._firsts)
            first = self._find(name, at, local=local, begun=begun)
            if files < len(self._firsts):  # another file may have a subprogram of this name
                return first
            self._called[call] = first
        return self._called[call]

    def _find(self, name: str, at: int, *, local: bool, begun: bool) -> int:
        labelled = self._labelled.get(name, [])
        if not local:
            self._refuse_several(labelled, name)
        own = [i for i in labelled if self._file(i) == self._file(at)]
        found = own or [i for i in labelled if self._file(i) == 0 and not local]
        if found or local:
            inside = self._one(found, name, "the file")
            if not local:
                self.files.refuse_beside(name, inside)
            return inside + 1
        first = self.files.first_block(name, at)
        if first > len(self._programs):
            self.ends.add(len(self._programs))
            self._programs.append(-1)
            self._take(first)
            self._taken(first)
        self._refuse_several(self._labelled.get(name, []), name)
        file = self._file(first)
        begins = [i for i in self._labelled.get(name, []) if self._file(i) == file]
        several = file + 1 < len(self._firsts)
        here = range(first, self._firsts[file + 1] - 1 if several else len(self.blocks))
        if begins or begun or any(self._begins(self.blocks[i]) for i in here):
            return self._one(begins, name, self.files.name(first)) + 1
        return first

    def _refuse_several(self, labelled: Sequence[int], name: str) -> None:
        """NotKnown for a subprogram in several files: LinuxCNC runs the one that it has met first."""
        files = {self._file(i): self.files.name(i) for i in labelled}
        if len(files) > 1:
            raise NotKnown(
                f"{' and '.join(files.values())} both have a subprogram {shown_name(name)}: rename one of them"
            )

    @staticmethod
    def _one(found: Sequence[int], name: str, where: str) -> int:
        if len(found) != 1:
            raise NotKnown(
                f"{where} has {len(found) or 'no'} subprogram{'s' * bool(found)} {shown_name(name)}: write it into the "
                "file once"
            )
        return found[0]

    def _take(self, first: int) -> None:
        """Take the blocks of a file, from `first` on."""
        self._called.clear()
        self._firsts.append(first)
        program = len(self._programs)  # larger than the number of any program before
        for i, block in enumerate(itertools.islice(self.blocks, first, None), start=first):
            program += self._begins(block)
            self._programs.append(program)
            for label in self._labels(block):
                self._labelled.setdefault(label, []).append(i)

    def _file(self, at: int) -> int:
        """Number of the file of a block, or of its end; 0 for the main program."""
        return bisect.bisect_right(self._firsts, at) - 1
