"""The one exception for input that cannot be used."""


class UserError(Exception):
    """The user's input cannot be used: one clear message, exit status 2, no output file."""
