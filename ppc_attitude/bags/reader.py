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

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from ppc_attitude.bags.collected import Collected, readings
from ppc_attitude.bags.custom_data import RECOVERED_KEY, decode_custom_data, usable
from ppc_attitude.bags.errors import BagError, printable, shortened
from ppc_attitude.bags.folder import Bag
from ppc_attitude.bags.timeline import Series, Timeline, align
from ppc_attitude.contract.carriers import carriers
from ppc_attitude.contract.declared import (
    BY_COLUMN,
    BY_NAME,
    SAMPLED,
    components_of,
    not_installed,
    promised,
)
from ppc_attitude.contract.run_record import Change, RunRecord, told
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    CONTROLLER,
    ENABLED,
    PLANT,
    Topic,
)
from ppc_attitude.contract.versions import of_another_state, versions_of_others
from ppc_attitude.science.component import read_from_elsewhere
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.science.stamps import LATEST, instant, stamp_of


def read_run(
    path: Path | str,
    namespace: str | None = None,
    *,
    topics: Mapping[str, str] | None = None,
    whole: bool = False,
) -> RunRecord:
    """Read a run from a bag.

    If several messages of a topic have one stamp, the first counts. If the plant's clock went
    back, what came before is left out, with a warning. Memory beyond the result is a few blocks
    of the bag, one topic, and 16 bytes a message.

    Parameters
    ----------
    path : Path or str
        Folder of a rosbag2 bag, or an ``.mcap`` or ``.db3`` file.
    namespace : str, optional
        Namespace of the run, such as ``/proposed``; needed only if the bag holds several runs.
    topics : mapping of str to str, optional
        Topic of the contract (``attitude``) to the one of the bag that carries it (``/imu/data``),
        where the names differ.
    whole : bool
        Whether the bag must hold every topic that the nodes of the run send, by what it says of
        them.

    Returns
    -------
    RunRecord
        Every topic of the contract that the bag has. NaN and counts in `missing` where a message
        is missing; `warnings` say whether the recording was cut or goes on, and which topics the
        bag lacks although nodes of the run send them.

    Raises
    ------
    BagError
        No bag, an unreadable one, or one without what was asked for.
    """
    names = _checked(topics or {})
    bag = Bag(path)
    home = None if namespace is None else f"/{namespace.strip('/')}".rstrip("/")
    collected = _collect(bag, home, names)
    if home is None:
        home = _only_namespace(bag, names)
    elif not names and home not in (found := _by_namespace(bag)):
        known = ", ".join(each or "/" for each in _run_namespaces(bag) or sorted(found))
        raise BagError(f"{bag.path} has no run in the namespace {home or '/'}; it has: {known}")
    return _record(bag, collected, home, whole=whole)


def read_runs(path: Path | str, topics: Mapping[str, str] | None = None) -> list[RunRecord]:
    """Read every run of a bag, sorted by namespace; if there are several, each `source` names it.

    Raises
    ------
    BagError
        See `read_run`; or the bag holds several runs and `topics` are given.
    """
    names = _checked(topics or {})
    bag = Bag(path)
    collected = _collect(bag, None, names, or_ours=True)  # some of several bags may have our names
    homes = [] if names else _run_namespaces(bag)
    records = [_record(bag, collected, home) for home in homes or [_only_namespace(bag, names)]]
    if len(records) == 1:
        return records
    return [
        replace(record, source=f"{record.source} {home or '/'}")
        for record, home in zip(records, homes, strict=True)
    ]


def _checked(topics: Mapping[str, str]) -> dict[Topic, str]:
    """Topics of the contract with the absolute names that they are to have in a bag."""
    names = {}
    for ours, theirs in topics.items():
        topic = BY_NAME.get(ours.strip("/"))
        if topic is None or not topic.column:
            allowed = ", ".join(each.name for each in SAMPLED)
            raise BagError(f"a run has no topic {ours} with samples; allowed: {allowed}")
        names[topic] = "/" + theirs.strip("/")
    return names


def _collect(
    bag: Bag, home: str | None, names: Mapping[Topic, str], *, or_ours: bool = False
) -> Collected:
    collected = Collected(home, names)
    for channels, block in bag.blocks():
        collected.add(channels, block)
    if not bag.counts.total():
        raise BagError(f"{bag.path} holds no messages{_flaws(bag)}")
    for topic, name in names.items():
        msgtype = bag.topics.get(name)
        ours = or_ours and any(topic in found for found in _by_namespace(bag).values())
        if msgtype is None and not ours:
            raise BagError(
                f"{bag.path} has no topic {name} for {topic.name}; it holds {_held(bag)}"
            )
        if msgtype is not None and msgtype not in carriers(topic):
            raise BagError(f"{name} cannot be read as {topic.name}: {_wrong_type(topic, msgtype)}")
    return collected


def _record(bag: Bag, collected: Collected, home: str, *, whole: bool = False) -> RunRecord:
    series, changes = collected.series(home, bag.topics), collected.changes(home)
    facts, flaws = decode_custom_data(bag.custom_data, home), list[str]()
    changes = [c for c in changes if usable(c[1].node, {c[1].name: c[1].value}, flaws)]
    if not series:
        raise BagError(f"{bag.path} has no message that can be used{_flaws(bag)}")
    lacking = _lacking(bag, home, series, facts.parameters)
    lacks = f"lacks messages of {', '.join(lacking.values())}"
    if lacking and whole:
        read = ", ".join(
            f"{topic.name} ({len(messages.stamps)})" for topic, messages in series.items()
        )
        raise BagError(f"{bag.path} {lacks}; messages read: {read}{_flaws(bag)}")
    recovered = bag.custom_data.get(RECOVERED_KEY)
    cut = [*bag.flaws, f"{recovered} (since recovered)"] if recovered else bag.flaws
    timeline, parameters, in_flight = _aligned(series, facts.parameters, changes, cut=bool(cut))
    announced = (topic.name for topic in lacking if f"{home}/{topic.name}" in bag.topics)
    missing = {**timeline.missing, **dict.fromkeys(announced, len(timeline.stamps))}
    record = RunRecord(
        source=printable(str(bag.path)),
        controller=str(parameters.get(CONTROLLER, {}).get(CONTROLLERS.selector, facts.controller)),
        stamps_ns=timeline.stamps,
        columns=timeline.columns,
        held=timeline.held,
        parameters=parameters,
        changes=tuple(
            each
            for each, old in told(in_flight, parameters)
            if each.value != old or each.name == ENABLED  # which also marks that a node began anew
        ),
        metadata=facts.metadata,
    )
    # A node that was started again may run another component, which gives other columns.
    *_, (_, last) = record.stretches(in_flight)
    others = {topic.name for each in (parameters, last) for topic in _of_others(each)}
    warnings = [
        *([f"{_state(bag)}: {'; '.join(cut)}; read up to {record.t[-1]:.12g} s"] if cut else ()),
        *(*facts.flaws, *flaws, *collected.warnings(home), *timeline.warnings),
        *([f"the bag {lacks}{_why_it_may_lack(facts.metadata)}"] if lacking else ()),
        *_of_other_packages(record),
        *_of_the_ends(record, cut=bool(cut)),
    ]
    return replace(
        record,
        columns={
            name: rows
            for name, rows in timeline.columns.items()
            if BY_COLUMN[name].name not in others or np.isfinite(rows).any()
        },
        missing={name: count for name, count in missing.items() if name not in others},
        warnings=tuple(map(printable, warnings)),
    )


def _aligned(
    series: dict[Topic, Series],
    parameters: NodeParameters,
    changes: Iterable[tuple[int, Change]],
    *,
    cut: bool,
) -> tuple[Timeline, NodeParameters, list[Change]]:
    """Align the messages; also return the parameters of the begin, and what changed since."""
    again = any((each.node, each.name) == (PLANT, ENABLED) for _, each in changes)
    plant = parameters.get(PLANT, {})
    # A plant that was started again may have another rate; `align` empties what it is given.
    for messages in (dict(series), series) if again else (series,):
        timeline = align(messages, plant.get("rate"), cut=cut, end_ns=_end_ns(plant))
        began, in_flight = _of_last_epoch(parameters, changes, timeline)
        if began.get(PLANT, {}) == plant:
            break
        plant = began[PLANT]
    return timeline, began, sorted(in_flight, key=attrgetter("stamp_ns"))


def _end_ns(plant: Mapping[str, Any]) -> int | None:
    """Last stamp of a plant with these parameters [ns]; None if it has no end, or they say none."""
    rate, duration = plant.get("rate"), plant.get("duration")
    return stamp_of(round(duration * rate), rate) if rate and duration else None


def _of_other_packages(record: RunRecord) -> Iterator[str]:
    """Yield warnings of components and packages that are another here, or not there."""
    if unknown := not_installed(record.parameters):
        yield f"not installed: {', '.join(unknown)}; columns that only these give are not read"
    for name, version in versions_of_others().items():
        if (was := record.metadata.get(name, version)) != version:
            yield (
                f"package {name} was {was} in the run and is {version} here: its columns and "
                f"parameters are read as {version} declares them"
            )


def _of_the_ends(record: RunRecord, *, cut: bool) -> Iterator[str]:
    """Yield warnings of a record that does not begin or end as its run did."""
    plant = record.parameters.get(PLANT, {})
    begin, end, end_ns = record.t[0], record.t[-1], _end_ns(plant)
    if plant.get("rate") and 0.0 < begin <= LATEST:
        yield (
            f"the record begins at {instant(begin)} s: earlier inputs, and the states that "
            "components had reached, are not in it, so a replay may differ"
        )
    if not cut and end_ns and record.stamps_ns[-1] < end_ns:
        yield (
            f"the record ends at {end:.12g} s, before the plant's duration of "
            f"{plant['duration']:.12g} s: events scheduled after its end are not in it"
        )


def _of_last_epoch(
    parameters: NodeParameters,
    changes: Iterable[tuple[int, Change]],
    timeline: Timeline,
) -> tuple[NodeParameters, list[Change]]:
    """Parameters with which the last epoch began, and what was changed during it.

    When time begins again, a node publishes all its earlier changes again, with that stamp. In the
    bag such a message may come before the state, and an older message of the node after it. The
    parameters of a restarted node are told only once, by the recorder, when it hears of them.
    """
    if timeline.begun is None:
        return parameters, [change for _, change in changes]
    began: dict[str, dict[str, Any]] = {node: dict(own) for node, own in parameters.items()}
    first: dict[tuple[str, str], Change] = {}
    later: dict[str, list[Change]] = {}
    for arrival, change in changes:
        node, name = change.node, change.name
        if change.stamp_ns <= timeline.stamps[0]:
            first[node, name] = change
            later.pop(node, None)
        elif arrival >= timeline.begun:
            later.setdefault(node, []).append(change)
        else:
            first.pop((node, name), None)
            if name in began.get(node, {}):
                began[node][name] = change.value
    for node, name in first.keys() & {(node, name) for node, own in began.items() for name in own}:
        began[node][name] = first.pop((node, name)).value
    # A node that is enabled as time begins again starts that way: nothing changes in flight.
    first = {key: each for key, each in first.items() if key[1] != ENABLED or not each.value}
    return began, [*first.values(), *chain(*later.values())]


def _by_namespace(bag: Bag) -> dict[str, set[Topic]]:
    """Topics of the contract that the bag has messages of, by namespace, for every reading."""
    topics: dict[str, set[Topic]] = {}
    for name, msgtype in bag.topics.items():
        if bag.counts.get(name):
            for home, topic in readings(name, msgtype):
                topics.setdefault(home, set()).add(topic)
    return topics


def _run_namespaces(bag: Bag) -> list[str]:
    """Namespaces with all that a plant sends; if none has, with what can only be an attitude."""
    # `reference/attitude` looks like a run of its own, with the topics of the reference only.
    plant = {ATTITUDE, ANGULAR_VELOCITY, APPLIED_TORQUE}
    plain = [name for name, msgtype in bag.topics.items() if len([*readings(name, msgtype)]) == 1]
    topics = _by_namespace(bag)
    whole = [home for home, found in topics.items() if plant <= found]
    alone = [home for home, found in topics.items() if ATTITUDE in found]
    return sorted(whole or [home for home in alone if f"{home}/{ATTITUDE.name}" in plain])


def _only_namespace(bag: Bag, names: Mapping[Topic, str]) -> str:
    """Namespace of the bag's only run."""
    homes = _run_namespaces(bag)
    if len(homes) > 1:
        known = ", ".join(home or "/" for home in homes)
        raise BagError(f"{bag.path} holds {len(homes)} runs; choose a namespace: {known}")
    if homes:
        return homes[0]
    topics = _by_namespace(bag)
    if topics:
        return max(sorted(topics), key=lambda home: len(topics[home]))
    if names:
        return ""
    raise BagError(
        f"{bag.path} is no run of this package; it holds {_held(bag)}{_flaws(bag)}; "
        "say which topic carries which quantity (such as --topic attitude=/imu/data)"
    )


def _held(bag: Bag) -> str:
    topics = sorted(bag.topics.items())
    return ", ".join(f"{shortened(name)} ({shortened(msgtype)})" for name, msgtype in topics)


def _lacking(
    bag: Bag, home: str, series: Collection[Topic], parameters: NodeParameters
) -> dict[Topic, str]:
    """Topics that a run should have and has not, and why if the bag has them after all."""
    found = {}
    sent, others = promised(parameters), _of_others(parameters)
    beside = {*_run_namespaces(bag)} - {home}
    for topic in SAMPLED:
        name = f"{home}/{topic.name}"
        msgtype = bag.topics.get(name, topic.msgtype)
        of_another = topic not in sent and beside & dict(readings(name, msgtype)).keys()
        if topic in series or topic in others or of_another:
            continue
        if msgtype not in carriers(topic):
            found[topic] = f"{topic.name} ({_wrong_type(topic, msgtype)})"
        elif topic in sent:
            why = " (none can be decoded)" if bag.counts.get(name) else ""
            found[topic] = f"{topic.name}{why}"
    return found


def _why_it_may_lack(metadata: Mapping[str, str]) -> str:
    told = of_another_state(metadata)
    return f"; {told}, whose nodes may not send them" if told else ""


def _of_others(parameters: NodeParameters) -> set[Topic]:
    """Topics that no component gives, of a node whose parameters are on record, and none reads."""
    known = {topic for topic in SAMPLED if topic.source in parameters}
    running = (components_of(node, own) for node, own in parameters.items())
    read = {BY_COLUMN[each.name] for parts in running for each in read_from_elsewhere(parts)}
    return known - read - set(promised(parameters))


def _wrong_type(topic: Topic, msgtype: str) -> str:
    return f"its type is {msgtype}; allowed: {', '.join(carriers(topic))}"


def _flaws(bag: Bag) -> str:
    return f"; {_state(bag)}: {'; '.join(bag.flaws)}" if bag.flaws else ""


def _state(bag: Bag) -> str:
    return "recording goes on" if bag.live else "recording was cut"
