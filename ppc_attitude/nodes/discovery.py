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

"""Who finds a node: range and domain, as the environment sets them, and the transports of Fast DDS.

The environment is checked here, because ROS replaces a range that it does not know by one that it
knows, and only warns.

Only times and transports of Fast DDS are set, no QoS: what ROS asks for stays in force. Another
middleware reads none of this, and a profile of the user's own takes precedence.

All messages go by UDP. Fast DDS takes the shared-memory port of a process that does not respond for
a second for dead and makes a new one; a process that still holds the old one is never heard again.
"""

import os
import random
import re
import socket
from collections.abc import Mapping, MutableMapping
from contextlib import suppress
from pathlib import Path

from ppc_attitude.science.errors import ConfigurationError

RANGE, DOMAIN, PEERS = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DOMAIN_ID", "ROS_STATIC_PEERS"
LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"  # older than the range, and takes precedence
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
MIDDLEWARE, OURS = "RMW_IMPLEMENTATION", "rmw_fastrtps"
_ALLOWED = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
_LAST_DOMAIN = 232  # the last whose ports exist
DOMAINS = range(1, 101)  # the ports of 101 meet Linux's ephemeral ports, 32768 and above
_LOOPBACK, _MULTICAST = "127.0.0.1", "239.255.0.1"  # the second is that of DDS-RTPS
_PORT_BASE, _PORTS_PER_DOMAIN = 7400, 250  # DDS-RTPS, 9.6.2
_SOCKETS = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
ANYWHERE = Path(__file__).parent / "fast_dds.xml"
THIS_HOST = Path(__file__).parent / "fast_dds_this_host.xml"
_NO_OTHER = "SKIP_DEFAULT_XML_FILE"  # Fast DDS would read a file in the current folder as well


def check_discovery(environment: Mapping[str, str]) -> None:
    """See that nodes of this environment can find each other, and are found where it says.

    Raises
    ------
    ConfigurationError
        The range, the domain or a peer is invalid; the message names it and what is allowed. Or no
        network interface for discovery is up, unless the sockets are the user's choice.
    """
    allowed = ", ".join(_ALLOWED)
    chosen = environment.get(RANGE, "")
    if chosen == "OFF":
        raise ConfigurationError(f"{RANGE} = OFF: no node would find another; allowed: {allowed}")
    if chosen and chosen not in _ALLOWED:
        raise ConfigurationError(f"{RANGE} = {chosen!r}; allowed: {allowed}")
    domain = environment.get(DOMAIN, "") or "0"
    # ROS reads a number that begins with 0 as octal.
    if not (re.fullmatch("0|[1-9][0-9]{0,2}", domain) and int(domain) <= _LAST_DOMAIN):
        raise ConfigurationError(
            f"{DOMAIN} = {domain!r}; allowed: 0 to {_LAST_DOMAIN}, without leading zeros"
        )
    for peer in _peers(environment):
        try:
            socket.getaddrinfo(peer, None)
        except (OSError, UnicodeError):
            raise ConfigurationError(
                f"{PEERS}: {peer!r} is no address and no known host name; allowed: addresses or "
                "host names, separated by semicolons"
            ) from None
    ways = (_LOOPBACK,) if keeps_to_this_host(environment) else (_LOOPBACK, _MULTICAST)
    if not (chosen_by_user(environment) or any(map(_has_way, ways))):
        raise ConfigurationError(
            "the network interface lo (loopback) is down, so that no node would find another; "
            "bring it up, for example by `ip link set lo up`"
        )


def _has_way(address: str) -> bool:
    """Whether this host has an interface for packets to an address; none is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        return sender.connect_ex((address, _PORT_BASE)) == 0


def keeps_to_this_host(environment: Mapping[str, str]) -> bool:
    """True if the environment asks for this host alone."""
    local = environment.get(RANGE) == "LOCALHOST" or environment.get(LOCALHOST_ONLY) == "1"
    return local and not _peers(environment)


def _peers(environment: Mapping[str, str]) -> list[str]:
    return [peer for peer in environment.get(PEERS, "").split(";") if peer]


def chosen_by_user(environment: Mapping[str, str]) -> str:
    """Name the user's setting that decides on sockets in our place; empty if there is none."""
    if not (environment.get(MIDDLEWARE) or OURS).startswith(OURS):
        return MIDDLEWARE
    return next((name for name in (*PROFILES, TRANSPORTS) if environment.get(name)), "")


def reach(environment: Mapping[str, str]) -> str:
    """Say, in words, from where the nodes of this environment can be reached."""
    if not keeps_to_this_host(environment):
        peers = f" and {PEERS}" if _peers(environment) else ""
        return (environment.get(RANGE) or "SUBNET").lower() + peers
    other = chosen_by_user(environment)
    return f"localhost, with the transports that {other} selects" if other else "localhost"


def unused_domains() -> list[int]:
    """Domains without a participant on this host; all domains if the system does not tell."""
    used = set()
    for table in _SOCKETS:
        with suppress(OSError):
            for row in table.read_text(encoding="ascii").splitlines()[1:]:
                port = int(row.split()[1].rpartition(":")[2], 16)  # of the local address
                used.add((port - _PORT_BASE) // _PORTS_PER_DOMAIN)
    return [domain for domain in DOMAINS if domain not in used]


def choose_domain() -> int:
    """Return a random domain, one that nobody uses if there is one."""
    return random.SystemRandom().choice(unused_domains() or DOMAINS)


def tune_transport(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let Fast DDS read our profile; to be called before `rclpy.init`.

    With the range LOCALHOST, ROS would choose the transports, shared memory among them; a profile
    that knows no interface but loopback keeps to this host as well, and leaves the choice to us.

    Raises
    ------
    ConfigurationError
        The environment names an invalid range, domain or peer.
    """
    from rclpy import utilities  # not at the top: commands use the rest of this module without ROS

    check_discovery(environment)
    middleware = utilities.get_rmw_implementation_identifier()
    if chosen_by_user({**environment, MIDDLEWARE: middleware}):
        return
    environment[_NO_OTHER] = "1"
    if keeps_to_this_host(environment):
        environment.pop(LOCALHOST_ONLY, None)
        environment[RANGE] = "SYSTEM_DEFAULT"
        environment[PROFILES[0]] = str(THIS_HOST)
    else:
        environment[TRANSPORTS] = "UDPv4"
        environment[PROFILES[0]] = str(ANYWHERE)
