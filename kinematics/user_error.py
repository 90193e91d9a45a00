"""The one exception for input that can't be used."""


class UserError(Exception):
    """The user's input can't be used: one clear message, exit status 2, no output file."""
