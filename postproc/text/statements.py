"""Statements of a block, in addition to its words: assignments, jumps, loops, calls; shared by all dialects."""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

from postproc.text.expressions import Expression, NotKnown, Scope, Value, Variable, evaluate


class Simple(Protocol):
    """A statement after which the next one runs."""

    def run(self, scope: Scope) -> None:
        """Execute it; NotKnown if a value is missing."""


@runtime_checkable
class Setting(Simple, Protocol):
    """A statement that gives variables a value."""

    @property
    def target(self) -> Variable:
        """The variable that it names."""

    @property
    def value(self) -> Expression:
        """The formula of the value, or of the values."""

    @property
    def written(self) -> Variable:
        """The variable that it sets; with an index that is no constant where it sets several elements."""


class Assign(NamedTuple):
    """Give a variable a value."""

    target: Variable
    value: Expression

    @property
    def written(self) -> Variable:
        """The variable itself."""
        return self.target

    def run(self, scope: Scope) -> None:
        """Set it, or note why its value is not known."""
        indices = tuple(evaluate(index, scope) for index in self.target.indices)
        value: Value | NotKnown
        try:
            value = evaluate(self.value, scope)
        except NotKnown as reason:
            value = reason
        scope.set(self.target.name, indices, value)


class Label(NamedTuple):
    """A name for a block, to be jumped to."""

    name: str

    def run(self, scope: Scope) -> None:
        """Nothing happens."""


class Jump(NamedTuple):
    """Go on at a label: a text, or an expression whose value names it."""

    label: str | Expression
    directions: str = "FB"
    """Directions of the search for the label, in their order: towards the end (F), the beginning (B)."""
    optional: bool = False
    """Go on behind the jump where there is no such label."""


class When(NamedTuple):
    """Do something on a condition."""

    condition: Expression
    then: Step
    otherwise: Step | None = None


class Select(NamedTuple):
    """Run the branch of the first value that equals the expression, otherwise the default."""

    value: Expression
    cases: tuple[tuple[Expression, Jump], ...]
    default: Jump | None


class Begin(NamedTuple):
    """Opens a structure: IF, WHILE, FOR, LOOP, DO, REPEAT, or SUB, which runs only when it is called."""

    kind: str
    key: str = ""
    """Number or name that opening and end share, where the dialect has one."""
    test: Expression | None = None
    """Condition of IF and WHILE, number of iterations of REPEAT, last value of FOR."""
    counter: Variable | None = None
    first: Expression | None = None
    """Loop variable of FOR."""


class Else(NamedTuple):
    """The other branch of an IF, with a condition or without."""

    key: str = ""
    test: Expression | None = None


class End(NamedTuple):
    """Closes a structure; one that is run at least once has its condition here."""

    kind: str
    key: str = ""
    until: Expression | None = None
    """The condition of its end."""
    again: Expression | None = None
    """The condition on which it is not."""


class Leave(NamedTuple):
    """Go on behind a loop."""

    key: str = ""


class Again(NamedTuple):
    """Go on with the next iteration of a loop."""

    key: str = ""


class Call(NamedTuple):
    """Run a subprogram."""

    name: str | Expression
    arguments: tuple[tuple[int, Expression], ...] | None = ()
    """Number of a local variable, and its value; None when it has the variables of its caller."""
    times: Expression | None = None
    local: bool = False
    """True if it is in the file of the call."""
    begun: bool = False
    """True if the subprogram must have its own beginning in a file, as the subroutines of LinuxCNC."""
    at_label: bool = False
    """True if it begins with the block of a label in the same program."""


class Taken(NamedTuple):
    """The part of a block that calls a program, and that the blocks of this program replace when it is written out."""

    at: int
    end: int

    def run(self, scope: Scope) -> None:
        """Nothing happens."""


class Return(NamedTuple):
    """The end of a subprogram."""

    outside: str = ""
    """Reason for a refusal outside of a subprogram; empty if it then has no effect."""
    label: Expression | None = None
    """Block of the caller that runs next, instead of the one behind the call; in the main program a jump."""
    local: bool = False
    """True if it ends subprograms of the file alone, and not the program of the file."""


class Modal(NamedTuple):
    """Run a subprogram behind every move from here on."""

    call: Call
    words: tuple[str, str, str] = ("G66", "G67", "G65")
    """What begins it, what ends it, and what calls a subprogram once; for messages."""
    single: bool = False
    """True if it replaces another modal call, which ncomp does not follow."""


class EndModal(NamedTuple):
    """End the last of the modal calls, if any."""

    def run(self, scope: Scope) -> None:
        """Nothing to end where the program has none."""


class Rerun(NamedTuple):
    """Run the part of the program between two labels again."""

    first: str
    last: str
    """Nothing: up to the statement itself."""
    times: Expression | None = None
    end_label: str = ""
    """The label that ends every part without one of its own, if the language has one."""


Step: TypeAlias = Simple | Jump | When | Select | Begin | Else | End | Leave | Again | Call | Return | Modal | Rerun
TURNS = (Jump, When, Select, Begin, Else, End, Leave, Again, Call, Return, Modal, Rerun)
"""Steps after which not always the next one runs."""


class Code(NamedTuple):
    """The statements of a block."""

    before: tuple[Step, ...] = ()
    """Run before its words."""
    after: tuple[Step, ...] = ()
    """Run behind them."""

    @property
    def turns(self) -> bool:
        """True when not always the next block runs."""
        return any(turns(step) for step in self.before + self.after)


def turns(step: Step) -> bool:
    """True when not always the next step runs."""
    return isinstance(step, TURNS) and not (isinstance(step, When) and not turns(step.then) and step.otherwise is None)
