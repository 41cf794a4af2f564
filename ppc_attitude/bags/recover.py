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

"""Finishing a bag whose recorder was killed."""

import contextlib
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rosbags.rosbag2.metadata import parse_qos

from ppc_attitude.bags.custom_data import METADATA, RECOVERED_KEY, UNFINISHED, claim
from ppc_attitude.bags.errors import BagError, shortened
from ppc_attitude.bags.folder import STORAGES, Bag
from ppc_attitude.bags.source import Channel, payloads_of
from ppc_attitude.bags.sqlite_source import settle
from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.contract.whole_file import unfinished_of
from ppc_attitude.contract.yaml_file import parsed

_WORK = ".recovering"


class Recovery(NamedTuple):
    """A bag that is complete now, with the number of its messages by topic.

    It begins and ends at the first and last time of receipt [ns]; its flaws are why it was cut. Its
    folder is that of the cut bag, or another one if the cut bag may hold more.
    """

    folder: Path
    counts: Counter[str]
    start_ns: int
    end_ns: int
    flaws: tuple[str, ...]


def recover(path: Path | str) -> Recovery:
    """Finish a cut bag: write its index and ``metadata.yaml``.

    The bag is copied inside its folder, so that needs as much space again. The custom data of the
    copy say that it was cut. When it is complete it replaces the original, if that lacks its end
    only; else the original stays as it is, with the copy beside it in ``FOLDER.recovered``. Only
    what this call has made is removed.

    Raises
    ------
    BagError
        The bag is complete, is still being recorded, holds nothing, or cannot be written; or
        something else is where it is to be, such as what a killed recovery has left.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise BagError(f"{folder} is not the folder of a bag")
    try:
        descriptor = claim(folder)
        try:
            cut = _cut(folder)
            with _new_folder(folder / _WORK) as work:
                return (_put_beside if cut.damaged else _put_in_place)(cut, folder, work)
        finally:
            os.close(descriptor)
    except OSError as error:
        reason = error.strerror or error.args[0]
        raise BagError(f"{folder} cannot be recovered: {reason}") from error


def _cut(folder: Path) -> Bag:
    """Read the bag of one file to its end, once it is known to be cut."""
    bag = Bag(folder)
    if len(bag.files) != 1 or bag.files[0].suffix not in STORAGES:
        names = ", ".join(file.name for file in bag.files)
        raise BagError(f"{folder} has {names}; allowed: one file .mcap or .db3")
    for _ in bag.blocks():
        pass
    if not bag.flaws:
        raise BagError(f"{folder} was closed by its recorder, there is nothing to recover")
    if not bag.counts.total():
        found = "; ".join(bag.flaws)
        raise BagError(f"{folder} holds no messages that can be recovered: {found}")
    return bag


@contextlib.contextmanager
def _new_folder(work: Path) -> Iterator[Path]:
    try:
        work.mkdir()
    except FileExistsError as error:
        told = "perhaps a recovery that was killed left it; move or delete it, and recover again"
        raise BagError(f"{work} exists already: {told}") from error
    try:
        yield work
    finally:
        shutil.rmtree(work)


def _put_beside(cut: Bag, folder: Path, work: Path) -> Recovery:
    """Write the copy beside a bag that may hold more than can be read; that stays as it is."""
    whole = folder.resolve()
    target = whole.with_name(f"{whole.name}.recovered")
    if os.path.lexists(target):
        told = "the recovered bag is to be there; move or delete it, and recover again"
        raise BagError(f"{target} exists already: {told}")
    recovery = _copy(Bag(folder), work / target.name, cut)
    (work / target.name).rename(target)
    return recovery._replace(folder=target)


def _put_in_place(cut: Bag, folder: Path, work: Path) -> Recovery:
    original = cut.files[0]
    if original.suffix == ".db3":
        settle(original, work)
    copy = work / folder.resolve().name
    recovery = _copy(Bag(folder), copy, cut)
    (finished,) = (file for file in copy.iterdir() if file.suffix in STORAGES)
    target = folder / finished.name
    if target != original and os.path.lexists(target):
        raise BagError(f"{target} exists already and is not of this bag: move or delete it")
    finished.replace(target)
    if target != original:
        original.unlink()
    (copy / METADATA).replace(folder / METADATA)
    mark = folder / UNFINISHED
    for each in (mark, unfinished_of(mark)):
        each.unlink(missing_ok=True)
    return recovery._replace(folder=folder)


def _copy(bag: Bag, copy: Path, cut: Bag) -> Recovery:
    """Write every message of a bag into another one; `cut` is the same bag, read to its end."""
    first, last = 2**63 - 1, 0
    announced: set[str] = set()
    storage = STORAGES[bag.files[0].suffix]
    with BagWriter(copy, storage=storage, custom_data=cut.custom_data) as writer:
        for channels, block in bag.blocks():
            for channel in channels.values():
                if channel.topic in announced:
                    continue
                # A topic of an unknown type is left out if it has no message: nothing is lost.
                if cut.counts.get(channel.topic) or writer.knows(channel.msgtype):
                    _announce(writer, channel)
                    announced.add(channel.topic)
            for key, time, data in zip(
                block.channel.tolist(), block.time.tolist(), payloads_of(block), strict=True
            ):
                writer.write(channels[key].topic, time, data)
            first = min(first, int(block.time.min(initial=first)))
            last = max(last, int(block.time.max(initial=last)))
        writer.set_custom_data(RECOVERED_KEY, "; ".join(bag.flaws))
    return Recovery(copy, bag.counts, first, last, tuple(bag.flaws))


def _announce(writer: BagWriter, channel: Channel) -> None:
    try:
        profiles = parsed(channel.offered_qos)
        if isinstance(profiles, str):  # would be taken for YAML, of any depth
            raise TypeError
        qos = parse_qos(profiles)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        told = f"the QoS of {channel.topic} is {shortened(channel.offered_qos)!r}"
        raise BagError(f"{told}, allowed is a list of profiles as rosbag2 writes it") from error
    writer.add_topic(channel.topic, channel.msgtype, qos)
