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

"""Discovery, as the environment sets it: checked, because ROS guesses where a value is wrong.

ROS takes a range that it does not know for one that it does, and tells it in a warning.
"""

import re
import socket
from collections.abc import Mapping

from ppc_attitude.science.errors import ConfigurationError

RANGE, DOMAIN, PEERS = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DOMAIN_ID", "ROS_STATIC_PEERS"
LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"  # older than the range, and goes before it
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
MIDDLEWARE, OURS = "RMW_IMPLEMENTATION", "rmw_fastrtps"
_ALLOWED = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
_LAST_DOMAIN = 232  # the last whose ports exist


def check_discovery(environment: Mapping[str, str]) -> None:
    """See that nodes of this environment can find each other, and are found where it says.

    Raises
    ------
    ConfigurationError
        The range, the domain or a peer is none; names it and what is allowed.
    """
    allowed = ", ".join(_ALLOWED)
    chosen = environment.get(RANGE, "")
    if chosen == "OFF":
        raise ConfigurationError(f"{RANGE} = OFF: no node would find another; allowed: {allowed}")
    if chosen and chosen not in _ALLOWED:
        raise ConfigurationError(f"{RANGE} = {chosen!r}; allowed: {allowed}")
    domain = environment.get(DOMAIN, "") or "0"
    if not (re.fullmatch("0*[0-9]{1,3}", domain) and int(domain) <= _LAST_DOMAIN):
        raise ConfigurationError(f"{DOMAIN} = {domain!r}; allowed: 0 to {_LAST_DOMAIN}")
    for peer in _peers(environment):
        try:
            socket.getaddrinfo(peer, None)
        except (OSError, UnicodeError):
            raise ConfigurationError(
                f"{PEERS}: {peer!r} is no address, and no name that is known; allowed: such, "
                "separated by semicolons"
            ) from None


def keeps_to_this_host(environment: Mapping[str, str]) -> bool:
    """True if the environment asks for this host alone."""
    local = environment.get(RANGE) == "LOCALHOST" or environment.get(LOCALHOST_ONLY) == "1"
    return local and not _peers(environment)


def _peers(environment: Mapping[str, str]) -> list[str]:
    return [peer for peer in environment.get(PEERS, "").split(";") if peer]


def chosen_by_user(environment: Mapping[str, str]) -> str:
    """Name the user's setting that decides on sockets in our place; empty if there is none."""
    if not environment.get(MIDDLEWARE, OURS).startswith(OURS):
        return MIDDLEWARE
    return next((name for name in (*PROFILES, TRANSPORTS) if name in environment), "")


def reach(environment: Mapping[str, str]) -> str:
    """Say, in words, from where the nodes of this environment can be reached."""
    if not keeps_to_this_host(environment):
        peers = f" and {PEERS}" if _peers(environment) else ""
        return (environment.get(RANGE) or "SUBNET").lower() + peers
    other = chosen_by_user(environment)
    return f"localhost, by sockets as {other} has them" if other else "localhost"
