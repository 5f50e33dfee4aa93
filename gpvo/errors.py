"""The one exception that a user's bad input raises."""


class InputError(ValueError):
    """Input that cannot be used; the message names the file, the field and the remedy.

    The command line prints the message as one line and exits with status 2.
    """
