"""Errors and warnings that tell a user what to change."""

from __future__ import annotations


class InputError(ValueError):
    """Unusable input from the user.

    The message is one sentence that names the file, the field and the value, and says the
    remedy. The command line prints it and exits with status 2.
    """


class InputWarning(UserWarning):
    """Input that was repaired or left out, as described by the message."""
