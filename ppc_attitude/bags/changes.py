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

"""Parameters that were changed in flight, as the nodes tell them on `parameters/changed`."""

import json
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from ppc_attitude.bags.errors import all_printable
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import CHANGES_TOPIC
from ppc_attitude.contract.yaml_file import parsed_json
from ppc_attitude.science.stamps import NANOSECONDS

MOST = 10_000
"""So many messages of changes are read at the most."""


@cache
def jazzy() -> Typestore:
    """Types of ROS 2 Jazzy; they take 0.1 s to import, and most commands need none."""
    return get_typestore(Stores.ROS2_JAZZY)


def encode_changes(changes: Iterable[Change]) -> Iterator[tuple[int, bytes]]:
    """Stamp [ns] and message of what was changed in flight, as the nodes tell it, one by one."""
    array, status, pair, header, time = (
        jazzy().types[name]
        for name in (
            CHANGES_TOPIC.msgtype,
            "diagnostic_msgs/msg/DiagnosticStatus",
            "diagnostic_msgs/msg/KeyValue",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    for change in changes:
        told = status(0, change.node, "", "", [pair(change.name, json.dumps(change.value))])
        stamp = time(*divmod(change.stamp_ns, NANOSECONDS))
        message = array(header(stamp, ""), [told])
        yield change.stamp_ns, bytes(jazzy().serialize_cdr(message, CHANGES_TOPIC.msgtype))


def decode_changes(data: bytes) -> list[Change]:
    """Changes that a message tells; rosbags raises many types of errors for other bytes."""
    message: Any = jazzy().deserialize_cdr(data, CHANGES_TOPIC.msgtype)
    stamp_ns = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
    return [
        Change(stamp_ns, *all_printable([status.name, pair.key, parsed_json(pair.value)]))
        for status in message.status
        for pair in status.values
    ]
