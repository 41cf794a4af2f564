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

"""Messages of a bag that may belong to a run, decoded while the bag is read."""

from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.bags.changes import MOST, decode_changes
from ppc_attitude.bags.errors import shortened
from ppc_attitude.bags.source import Block, Channel, split_rows
from ppc_attitude.bags.timeline import Series
from ppc_attitude.contract.carriers import carriers, decode_rows, is_stamped
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_NAME, SAMPLED
from ppc_attitude.contract.run_record import Array, Change
from ppc_attitude.contract.topics import ATTITUDE, CHANGES_TOPIC, Topic
from ppc_attitude.science.component import QUATERNION, UNIT_TOLERANCE


def readings(name: str, msgtype: str) -> Iterator[tuple[str, Topic]]:
    """Yield each namespace and topic of the contract that an absolute name can stand for."""
    before, *parts = name.split("/")
    for split in range(len(parts) if not before else 0):
        topic = BY_NAME.get("/".join(parts[split:]))
        if topic is not None and topic.column and msgtype in carriers(topic):
            yield "".join(f"/{part}" for part in parts[:split]), topic


class Collected:
    """Decoded messages of every topic that may be one of the contract's, by absolute name.

    Until the whole bag is read nobody knows whether ``/reference/attitude`` is the reference
    or the attitude of a run in the namespace ``/reference``; so names are resolved at the end.

    Parameters
    ----------
    namespace : str or None
        The run's, if it is known.
    names : mapping of Topic to str
        Topics of the contract that have another, absolute, name in the bag.
    """

    def __init__(self, namespace: str | None, names: Mapping[Topic, str]) -> None:
        self._namespace = namespace
        self._names = names
        self._parts: dict[str, list[Series]] = {}
        self._unreadable: Counter[str] = Counter()
        # How many messages have another frame, and what a node says of the first.
        self._strange: dict[str, tuple[int, str]] = {}
        self._notes: list[str] = []
        self._changes: dict[str, list[tuple[int, bytes]]] = {}  # with their arrival
        self._met = 0

    def add(self, channels: Mapping[int, Channel], block: Block) -> None:
        """Decode a block."""
        for key, indices, rows in split_rows(block):
            channel = channels[key]
            if channel.topic.endswith(f"/{CHANGES_TOPIC.name}"):
                kept = self._changes.setdefault(channel.topic, [])
                arrivals = (indices + self._met).tolist()
                taken = zip(arrivals, rows[: MOST - len(kept)], strict=False)
                kept += [(arrival, row.tobytes()) for arrival, row in taken]
            for name, topic in self._uses(channel):
                stamps, values, readable = decode_rows(topic, channel.msgtype, rows)
                readable &= stamps >= 0  # every node refuses a negative stamp
                if channel.msgtype == topic.msgtype:  # other types have other frames
                    self._look_at_frames(channel.topic, Codec(topic), rows, readable)
                told = stamps[readable]
                received = block.time[indices] if (told == told[:1]).all() else None
                part = Series(stamps, values, indices + self._met, received)
                if not readable.all():
                    self._unreadable[channel.topic] += int((~readable).sum())
                    part = part[readable]
                self._parts.setdefault(name, []).append(part)
        self._met += len(block.channel)

    def _look_at_frames(
        self, name: str, codec: Codec, rows: NDArray[np.uint8], readable: NDArray[np.bool_]
    ) -> None:
        """Count the messages that a node would have refused for their frame."""
        others = readable & codec.other_frames(rows)
        if others.any():
            frame = codec.decode(rows[others.argmax()].tobytes()).frame_id
            told = f"frame_id {shortened(frame)!r}; allowed: {codec.topic.frame_id!r}"
            count, told = self._strange.get(name, (0, told))
            self._strange[name] = count + int(others.sum()), told

    def series(self, namespace: str, types: Mapping[str, str]) -> dict[Topic, Series]:
        """Messages of the run in a namespace, which are kept here no longer.

        The types are those of all topics of the bag, by absolute name.
        """
        found = {}
        unstamped = False  # whether the attitude, and with it the run, counts by receipt
        for topic in SAMPLED:
            name = f"{namespace}/{topic.name}"
            ours = types.get(name) in carriers(topic)  # else it may be a topic of another run
            parts = self._parts.pop(name, []) if ours else []
            wanted = self._names.get(topic, name)
            if wanted in types:
                name, parts = wanted, self._parts.pop(topic.name, parts)
            elif parts:
                self._notes.append(f"there is no topic {wanted}: {name} is read for {topic.name}")
            if sum(len(part.stamps) for part in parts):
                series, received = self._joined(name, types[name], parts, unstamped)
                found[topic] = series
                unstamped |= received and topic.name == ATTITUDE.name
                if topic.form == QUATERNION:
                    self._look_at_norms(name, series.values)
        return found

    def _look_at_norms(self, name: str, values: Array) -> None:
        """Count the quaternions that a node would have refused; zeros are no estimate."""
        with np.errstate(over="ignore"):  # the numbers may be any
            norms = np.linalg.norm(values, axis=1)
        off = norms[(np.abs(norms - 1.0) > UNIT_TOLERANCE) & (norms > 0.0)]
        if off.size:
            told = f"{off.size} quaternions of {name} have another norm than 1, such as"
            self._notes.append(f"{told} {off[0]:.6g}; allowed: 1 within {UNIT_TOLERANCE:g}")

    def _joined(
        self, name: str, msgtype: str, parts: list[Series], unstamped: bool
    ) -> tuple[Series, bool]:
        """Join parts to one series; tell if the times of receipt take the place of its stamps."""
        stamps = np.concatenate([part.stamps for part in parts])
        values = np.concatenate([part.values for part in parts])
        arrival = np.concatenate([part.arrival for part in parts])
        received = [part.received for part in parts if part.received is not None]
        alike = (stamps == stamps[0]).all()  # then every part has the times of receipt
        parts.clear()
        varies = (values[1:] != values[0]).any()  # a constant may have been sent many times
        by_receipt = bool(alike and (varies or unstamped or not is_stamped(msgtype)))
        if by_receipt:
            told = "one stamp for all messages" if stamps[0] else "no stamps"
            self._notes.append(f"{name} has {told}: the times of receipt are taken")
            stamps = np.concatenate(received)
        elif alike and len(stamps) > 1:
            self._notes.append(f"{len(stamps)} equal messages of {name} have one stamp: one counts")
        order = np.argsort(arrival, kind="stable")
        joined = Series(stamps, values, arrival)
        return (joined[order] if (np.diff(order) != 1).any() else joined), by_receipt

    def changes(self, namespace: str) -> list[tuple[int, Change]]:
        """Arrival of each change in flight, and the change; messages that are none are counted."""
        name = f"{namespace}/{CHANGES_TOPIC.name}"
        found: list[tuple[int, Change]] = []
        for arrival, data in sorted(self._changes.get(name, [])):  # a block sorts them by length
            try:
                found += [(arrival, change) for change in decode_changes(data)]
            except Exception:  # whatever rosbags raises
                self._unreadable[name] += 1
        return found

    def warnings(self, namespace: str) -> list[str]:
        """Say which topics of the run hold messages that are unusable, or read in another way."""
        found = [
            (name, f"{n} messages of {name} have no readable value, or a stamp below 0: left out")
            for name, n in self._unreadable.items()
        ]
        found += [
            (name, f"{n} messages of {name} are read as if their frame were right: {why}")
            for name, (n, why) in self._strange.items()
        ]
        names = {f"{namespace}/{topic.name}" for topic in (*SAMPLED, CHANGES_TOPIC)}
        names |= {*self._names.values()}
        told = [text for name, text in found if name in names]
        told += dict.fromkeys(self._notes)  # one message may be read for two topics
        self._notes = []
        return told

    def _uses(self, channel: Channel) -> Iterator[tuple[str, Topic]]:
        """Topics that a channel may be: by a name that was given, or by its own."""
        for topic, name in self._names.items():
            if name == channel.topic and channel.msgtype in carriers(topic):
                yield topic.name, topic
        for home, topic in readings(channel.topic, channel.msgtype):
            if self._namespace in (None, home):
                yield channel.topic, topic
                return
