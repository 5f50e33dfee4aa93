"""What a user's bad input raises, and what a disk does that takes no more."""


class InputError(ValueError):
    """Input that cannot be used; the message names the file, the field and the remedy.

    The command line prints the message as one line and exits with status 2.
    """


class OutputError(Exception):
    """Results that cannot be written; the message names the file and what is saved.

    The command line prints the message as one line and exits with status 4.
    """
