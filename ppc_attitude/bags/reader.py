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

"""Reading a recorded run, finished or cut, into a `RunRecord`."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.bags.changes import MOST, changes_of
from ppc_attitude.bags.custom_data import RECOVERED_KEY, decode_custom_data
from ppc_attitude.bags.errors import BagError, printable
from ppc_attitude.bags.folder import Bag
from ppc_attitude.bags.source import Block, Channel, split_rows
from ppc_attitude.bags.timeline import Series, align
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.completeness import promised
from ppc_attitude.contract.declared import BY_NAME, SAMPLED
from ppc_attitude.contract.run_record import Array, Change, RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    CHANGES_TOPIC,
    PLANT,
    Topic,
)
from ppc_attitude.science.stamps import seconds, stamp_of

_Part = tuple[NDArray[np.int64], Array, NDArray[np.int64]]


def read_run(path: Path | str, namespace: str | None = None) -> RunRecord:
    """Read a run from a bag.

    Of several messages of a topic with one stamp the first counts. If the plant's clock went
    back, what came before is left out, with a warning. Memory beyond the result is a few blocks
    of the bag, one topic, and 16 bytes a message.

    Parameters
    ----------
    path : Path or str
        Folder of a rosbag2 bag, or an ``.mcap`` or ``.db3`` file.
    namespace : str, optional
        Namespace of the run, such as ``/proposed``; needed only if the bag holds several runs.

    Returns
    -------
    RunRecord
        Every topic of the contract that the bag has. NaN and counts in `missing` where a message
        is missing; `warnings` say whether the recording was cut or goes on.

    Raises
    ------
    BagError
        No bag, an unreadable one, or one without messages of a topic that the nodes of the run
        send.
    """
    bag = Bag(path, times=False)
    home = None if namespace is None else _tidy(namespace)
    collected = _collect(bag, home)
    return _record(bag, collected, _only_namespace(bag) if home is None else home)


def read_runs(path: Path | str) -> list[RunRecord]:
    """Read every run of a bag, by namespace in alphabetical order.

    Raises
    ------
    BagError
        See `read_run`.
    """
    bag = Bag(path, times=False)
    collected = _collect(bag, None)
    homes = _run_namespaces(bag) or [_only_namespace(bag)]
    return [_record(bag, collected, home) for home in homes]


def _collect(bag: Bag, home: str | None) -> "_Collected":
    collected = _Collected(home)
    for channels, block in bag.blocks():
        collected.add(channels, block)
    if not sum(bag.counts.values()):
        raise BagError(f"{bag.path} holds no messages{_flaws(bag)}")
    return collected


def _record(bag: Bag, collected: "_Collected", home: str) -> RunRecord:
    series, changes = collected.series(home), collected.changes(home)
    facts = decode_custom_data(bag.custom_data, home)
    _demand_topics(bag, home, series, promised(facts.parameters, series))
    recovered = bag.custom_data.get(RECOVERED_KEY)
    cut = [*bag.flaws, f"{recovered} (since recovered)"] if recovered else bag.flaws
    rate = _rate(facts.parameters)
    timeline = align(series, rate, cut=bool(cut), end_ns=_planned_end(facts.parameters, rate))
    warnings = [*facts.flaws, *collected.warnings(home), *timeline.warnings]
    if cut:
        end = seconds(int(timeline.stamps[-1]))
        warnings.insert(0, f"{_state(bag)}: {'; '.join(cut)}; read up to {end:g} s")
    return RunRecord(
        source=printable(str(bag.path)),
        controller=facts.controller,
        stamps_ns=timeline.stamps,
        columns=timeline.columns,
        missing=timeline.missing,
        parameters=facts.parameters,
        changes=changes,
        metadata=facts.metadata,
        warnings=tuple(map(printable, warnings)),
    )


class _Collected:
    """Decoded messages of every topic that may be one of the contract's, by absolute name.

    Until the whole bag is read nobody knows whether ``/reference/attitude`` is the reference
    or the attitude of a run in the namespace ``/reference``; so names are resolved at the end.
    """

    def __init__(self, namespace: str | None) -> None:
        self._namespace = namespace
        self._parts: dict[str, list[_Part]] = {}
        self._unreadable: dict[str, int] = {}
        self._changes: dict[str, list[bytes]] = {}
        self._met = 0

    def add(self, channels: Mapping[int, Channel], block: Block) -> None:
        """Decode a block."""
        for key, indices, rows in split_rows(block):
            channel = channels[key]
            if channel.topic.endswith(f"/{CHANGES_TOPIC.name}"):
                kept = self._changes.setdefault(channel.topic, [])
                kept += [row.tobytes() for row in rows[: MOST - len(kept)]]
                continue
            topic = self._topic_of(channel)
            if topic is None or channel.encoding != "cdr":
                continue
            stamps, values, readable = Codec(topic).decode_rows(rows)
            readable &= stamps >= 0  # every node refuses what was before time
            bad = len(rows) - int(readable.sum())
            if bad:
                self._unreadable[channel.topic] = self._unreadable.get(channel.topic, 0) + bad
                stamps, values, indices = stamps[readable], values[readable], indices[readable]
            self._parts.setdefault(channel.topic, []).append((stamps, values, indices + self._met))
        self._met += len(block.channel)

    def series(self, namespace: str) -> dict[Topic, Series]:
        """Messages of the run in a namespace; what was collected is given away."""
        found = {}
        for topic in SAMPLED:
            parts = self._parts.pop(f"{namespace}/{topic.name}", [])
            if sum(len(stamps) for stamps, _, _ in parts):
                stamps, values, arrival = map(np.concatenate, zip(*parts, strict=True))
                del parts
                order = np.argsort(arrival, kind="stable")
                if (np.diff(order) != 1).any():
                    stamps, values, arrival = stamps[order], values[order], arrival[order]
                found[topic] = Series(stamps, values, arrival)
        return found

    def changes(self, namespace: str) -> tuple[Change, ...]:
        """What was changed in flight; messages that are none are counted."""
        name = f"{namespace}/{CHANGES_TOPIC.name}"
        changes, unreadable = changes_of(self._changes.get(name, []))
        if unreadable:
            self._unreadable[name] = unreadable
        return changes

    def warnings(self, namespace: str) -> list[str]:
        """Say which topics of the run hold messages that are none."""
        return [
            f"{count} messages of {name} cannot be used"
            for name, count in self._unreadable.items()
            if name.startswith(f"{namespace}/")
        ]

    def _topic_of(self, channel: Channel) -> Topic | None:
        for home, topic in _readings(channel.topic, channel.msgtype):
            if self._namespace in (None, home):
                return topic
        return None


def _readings(name: str, msgtype: str) -> Iterable[tuple[str, Topic]]:
    """Ways to read an absolute name: namespace and topic of the contract."""
    parts = name.lstrip("/").split("/")
    for split in range(len(parts)):
        topic = BY_NAME.get("/".join(parts[split:]))
        if topic is not None and topic.column and topic.msgtype == msgtype:
            yield "".join(f"/{part}" for part in parts[:split]), topic


def _topics_by_namespace(bag: Bag) -> dict[str, set[str]]:
    topics: dict[str, set[str]] = {}
    for name, msgtype in bag.topics.items():
        if bag.counts.get(name):
            for home, topic in _readings(name, msgtype):
                topics.setdefault(home, set()).add(topic.name)
    return topics


def _run_namespaces(bag: Bag) -> list[str]:
    """Namespaces with all that a plant sends."""
    # `reference/attitude` looks like a run of its own, with the topics of the reference only.
    plant = {topic.name for topic in (ATTITUDE, ANGULAR_VELOCITY, APPLIED_TORQUE)}
    return sorted(home for home, names in _topics_by_namespace(bag).items() if plant <= names)


def _only_namespace(bag: Bag) -> str:
    """Namespace of the bag's only run."""
    homes = _run_namespaces(bag)
    if len(homes) > 1:
        names = ", ".join(home or "/" for home in homes)
        raise BagError(f"{bag.path} holds {len(homes)} runs; choose a namespace: {names}")
    if homes:
        return homes[0]
    topics = _topics_by_namespace(bag)
    if topics:
        return max(sorted(topics), key=lambda home: len(topics[home]))
    held = ", ".join(f"{name} ({msgtype})" for name, msgtype in sorted(bag.topics.items()))
    raise BagError(f"{bag.path} is no run of this package; it holds {held}{_flaws(bag)}")


def _demand_topics(
    bag: Bag, namespace: str, series: Mapping[Topic, Series], demanded: Iterable[Topic]
) -> None:
    lacking = [
        _lack(bag, f"{namespace}/{topic.name}", topic) for topic in demanded if topic not in series
    ]
    if not lacking:
        return
    read = ", ".join(f"{topic.name} ({len(one.stamps)})" for topic, one in series.items())
    raise BagError(
        f"{bag.path} lacks messages of {', '.join(lacking)}; "
        f"messages read: {read or 'none'}{_flaws(bag)}"
    )


def _lack(bag: Bag, name: str, topic: Topic) -> str:
    """Name of a topic that is missing, and why if the bag has it after all."""
    msgtype = bag.topics.get(name, topic.msgtype)
    if msgtype != topic.msgtype:
        return f"{topic.name} (it is {msgtype} instead of {topic.msgtype})"
    return topic.name if not bag.counts.get(name) else f"{topic.name} (none can be decoded)"


def _flaws(bag: Bag) -> str:
    return f"; {_state(bag)}: {'; '.join(bag.flaws)}" if bag.flaws else ""


def _state(bag: Bag) -> str:
    return "recording goes on" if bag.live else "recording was cut"


def _tidy(namespace: str) -> str:
    bare = namespace.strip("/")
    return f"/{bare}" if bare else ""


def _rate(parameters: Mapping[str, Mapping[str, Any]]) -> float | None:
    rate = parameters.get(PLANT, {}).get("rate")
    return float(rate) if isinstance(rate, int | float) and 0.0 < rate < 1e9 else None


def _planned_end(parameters: Mapping[str, Mapping[str, Any]], rate: float | None) -> int | None:
    """Stamp [ns] at which the plant ends by itself; None if it does not or nobody knows."""
    duration = parameters.get(PLANT, {}).get("duration")
    if rate is None or not isinstance(duration, int | float) or not 0.0 < duration < 1e9:
        return None
    return stamp_of(round(duration * rate), rate)
