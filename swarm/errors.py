"""What can go wrong with the world outside, and the exit code each becomes.

    SwarmError                 1  the run failed
    |-- UsageError             2  the person who typed it can mend it
    |   `-- ScenarioError      2  expected / got / where, before anything starts
    |-- MessageError              one payload from the bus: counted and ignored, never fatal
    |-- BusError               1  the router cannot be reached, opened, or does not answer
    `-- RecordingError         1  a recording cannot be read, or is not whole

Every text says what was expected, what was found, where, and what to do about it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SwarmError(Exception):
    """Root of the tree; `exit_code` is what the command line returns."""

    exit_code = 1


class UsageError(SwarmError):
    """A flag, a name or a file given by the user is wrong."""

    exit_code = 2


class ScenarioError(UsageError):
    """A scenario is not valid."""


class MessageError(SwarmError):
    """A payload is malformed, oversized, not finite or from a stranger."""


class BusError(SwarmError):
    """The bus cannot do what was asked of it."""


class RecordingError(SwarmError):
    """A recording is damaged, incomplete or not one of ours."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """End of a text about a word that is not known: the nearest that is, if one is near."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean '{near[0]}'?" if near else ""
