"""The errors and warnings that tell a user what to change."""

from __future__ import annotations


class InputError(ValueError):
    """Something that the user gave cannot be used.

    The message is one sentence that names the file, the field and the value, and says the
    remedy. The command line prints it and exits with status 2.
    """


class InputWarning(UserWarning):
    """Something that the user gave was repaired or left out; the message says what and how."""
