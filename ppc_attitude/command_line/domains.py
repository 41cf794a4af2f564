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

"""ROS domains that nobody on this host uses."""

import random
from collections.abc import Iterable
from pathlib import Path

DOMAINS = range(1, 101)  # the ports of 101 meet Linux's ephemeral ports, 32768 and above
_PORT_BASE, _PORTS_PER_DOMAIN = 7400, 250  # DDS-RTPS, 9.6.2
_SOCKETS = (Path("/proc/net/udp"), Path("/proc/net/udp6"))


def unused_domains() -> list[int]:
    """Domains without a participant on this host; all where the system does not tell."""
    bound = set(_bound_ports())
    return [domain for domain in DOMAINS if bound.isdisjoint(ports(domain))]


def ports(domain: int) -> range:
    """UDP ports of a domain.

    The first is for all participants, but some with discovery `LOCALHOST` do without; from the
    eleventh on each has two.
    """
    first = _PORT_BASE + _PORTS_PER_DOMAIN * domain
    return range(first, first + _PORTS_PER_DOMAIN)


def choose_domain() -> int:
    """Return a random domain, one that nobody uses if there is one."""
    return random.SystemRandom().choice(unused_domains() or DOMAINS)


def _bound_ports() -> Iterable[int]:
    for table in _SOCKETS:
        try:
            rows = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for row in rows:
            yield int(row.split()[1].rpartition(":")[2], 16)  # the local address
