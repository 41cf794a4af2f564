"""Namespaces as users type them."""

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from ppc_attitude.science.errors import ConfigurationError


def absolute_namespace(text: str) -> str:
    """Return a namespace, given with or without its slashes, as ROS takes it.

    Raises
    ------
    ConfigurationError
        It cannot be one.
    """
    result = f"/{text.strip('/')}"
    try:
        validate_namespace(result)
    except InvalidNamespaceException as error:
        reason = str(error).partition("\n")[0].rstrip(":")
        raise ConfigurationError(f"namespace {text!r}: {reason}") from None
    return result
