# Copyright 2026 the ppc_attitude authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
