"""Exit codes, and the errors that mean one of them."""

DONE = 0
REQUIREMENT_FAILED = 1
BAD_INPUT = 2
BROKEN = 3


class UsageError(ValueError):
    """The user asked for something impossible; exit code 2."""


class RunError(RuntimeError):
    """The run broke; exit code 3."""
