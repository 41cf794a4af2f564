"""The error that every floor raises for a value the user can correct."""


class ConfigurationError(ValueError):
    """A parameter is wrong; the message names it, its value and what is allowed."""
