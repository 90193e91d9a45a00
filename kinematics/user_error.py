"""The one exception for input that cannot be used."""


class UserError(Exception):
    """The user's input cannot be used: one clear message, exit status 2, no output file."""

    def __str__(self) -> str:
        """The message in one line: line ends and other control characters in names of files are written as escapes."""
        message = super().__str__()
        return message if message.isprintable() else "".join(map(_escaped, message))


def _escaped(character: str) -> str:
    return character if character.isprintable() else repr(character)[1:-1]
