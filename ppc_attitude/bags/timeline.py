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

"""From messages as they arrived to columns on one timeline.

The plant is the master of time: the instants of a run are the stamps of what it publishes,
completed to a regular grid where all of its messages of an instant are missing.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.bags.source import Integers
from ppc_attitude.contract.run_record import LONGEST, USUAL, Array, is_steady
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    PLANT,
    TRUE_ATTITUDE,
    TRUE_RATE,
    Topic,
)
from ppc_attitude.science.stamps import NANOSECONDS, seconds

# A message that comes late is followed within so many by one that is newer than all before;
# the stamps of a plant that was reset stay behind for longer.
_LONGEST_DELAY = 3
# Each costs a look at all stamps that follow; a topic that leaps more often has no rhythm.
_MOST_LEAPS = 100
# Periods within this ratio of each other, either way, are those of one rhythm with some losses.
_SAME_RHYTHM = 1.5
_FEWEST = 3  # messages that have a rhythm
# A killed recorder leaves the last instants without some of their messages: it takes what has
# gathered one topic after the other, and on a busy machine much has gathered.
_RAGGED_END = NANOSECONDS  # [ns]
# More missing instants than this times the messages of a topic, on average, are not filled in with
# NaN: a bag with messages of one topic only would take fifty times its size.
_LARGEST_FILL = 10
# The motion goes on between messages: so a sample of these that is held soon says nothing.
_MOTION = (ANGULAR_VELOCITY, TRUE_ATTITUDE, TRUE_RATE)


@dataclass(frozen=True)
class Series:
    """Messages of one topic as they arrived."""

    stamps: Integers  # [ns]
    values: Array  # a row each
    arrival: Integers  # their places in the bag, increasing
    received: Integers | None = None  # times [ns], if none has a stamp, or all have the same

    def __getitem__(self, which: slice | Integers | NDArray[np.bool_]) -> "Series":
        """Some of the messages."""
        received = None if self.received is None else self.received[which]
        return Series(self.stamps[which], self.values[which], self.arrival[which], received)


@dataclass(frozen=True)
class Timeline:
    """Columns of a run, as in `RunRecord`."""

    stamps: Integers
    columns: Mapping[str, Array]
    missing: Mapping[str, int]
    held: frozenset[str]
    warnings: tuple[str, ...]
    begun: int | None  # place in the bag of the state at which time began again, if it did


def align(
    series: dict[Topic, Series], rate: float | None, *, cut: bool, end_ns: int | None
) -> Timeline:
    """Put every topic on the plant's timeline.

    Parameters
    ----------
    series : dict of Topic to Series
        Messages of the sampled topics, at least one; emptied on the way, so that a long bag is not
        in memory twice.
    rate : float or None
        Rate of the plant [Hz] where it is known. Where it is not, the plant is not ours: topics
        whose stamps are not the attitude's are held, and a rhythm that changes has no gaps.
    cut : bool
        The recording ended abruptly: its last instants may lack messages without any loss.
    end_ns : int or None
        Stamp [ns] at which the plant ends by itself. A run that was stopped before, or has no such
        end, may lack the answers to its last state without any loss.
    """
    warnings: list[str] = []
    for topic in series:
        series[topic] = _without_leaps(topic, series[topic], warnings)
    master = _master(series)
    begun = _keep_last_epoch(series, master, warnings)
    for topic in series:
        series[topic] = _in_order(topic, series[topic], warnings)
    held = frozenset() if rate else _hold(series, master, warnings)
    recorded = [
        messages.stamps
        for topic, messages in series.items()
        if topic.source == PLANT and not topic.late
    ] or [series[master].stamps]
    most = _LARGEST_FILL * sum(len(messages.stamps) for messages in series.values()) // len(series)
    stamps, unfilled = _complete(_union(recorded), rate, most, warnings)
    if cut:
        most_lacking = int((stamps > stamps[-1] - _RAGGED_END).sum())
        stamps = _without_ragged_end(stamps, series, most_lacking)
    elif end_ns is None or stamps[-1] < end_ns:
        stamps = _without_ragged_end(stamps, series, 1)
    columns, missing = {}, {}
    for topic in list(series):
        messages = series.pop(topic)
        column, absent, strays = _spread(messages, stamps)
        columns[topic.column] = column
        if topic in held:  # of which nothing is missing before the first message
            begins = messages.stamps[0] if messages.stamps.size else stamps[-1] + 1
            absent -= int(np.searchsorted(stamps, begins))
        else:
            absent += unfilled
        if absent and not topic.late:
            missing[topic.name] = absent
        if strays:
            told = f"{strays} messages of {topic.name} have stamps that no state of the plant has"
            warnings.append(f"{told}: left out")
    return Timeline(
        stamps, columns, missing, frozenset(topic.column for topic in held), tuple(warnings), begun
    )


def _master(series: Mapping[Topic, Series]) -> Topic:
    """Topic that tells time: the attitude's, else the plant's with the most messages, or any."""
    if ATTITUDE in series:
        return ATTITUDE
    return max(
        series, key=lambda each: (not each.late, each.source == PLANT, len(series[each].stamps))
    )


def _hold(series: dict[Topic, Series], master: Topic, warnings: list[str]) -> frozenset[Topic]:
    """Put topics with stamps of their own on the master's: at each instant the latest counts.

    Rates and the truth are unknown from some time after their last message on.
    """
    stamps, held = series[master].stamps, set()
    for topic, messages in series.items():
        if topic.late or not _goes_its_own_way(messages.stamps, stamps):
            continue
        place = np.searchsorted(messages.stamps, stamps, side="right") - 1
        begun = place >= 0
        if topic in _MOTION and len(messages.stamps) >= _FEWEST:
            usual = float(np.quantile(np.diff(messages.stamps), USUAL))
            begun &= stamps - messages.stamps[place] <= LONGEST * usual
        place = place[begun]
        if place.size:
            oldest = seconds(int((stamps[begun] - messages.stamps[place]).max()))
            told = (
                f"{topic.name} has stamps of its own: at each instant of {master.name} its latest "
                f"message is used, which is at most {oldest:g} s old"
            )
            between = len(messages.stamps) - 1 - np.count_nonzero(np.diff(place))
            warnings.append(f"{told}; {between} others are not used" if between else told)
        else:
            warnings.append(f"{topic.name} begins after the last instant of {master.name}")
        series[topic] = Series(stamps[begun], messages.values[place], messages.arrival[place])
        held.add(topic)
    return frozenset(held)


def _goes_its_own_way(own: Integers, stamps: Integers) -> bool:
    """Whether a topic has other stamps than the master's, or a steady rhythm of its own.

    A reference that comes once a second has stamps of an attitude at 100 Hz, and lacks nothing.
    """
    if 2 * np.count_nonzero(~_places(own, stamps)[1]) > len(own):
        return True
    if min(len(own), len(stamps)) < _FEWEST:
        return len(own) < _FEWEST <= len(stamps)
    steps = np.diff(own)
    period = float(np.median(steps))
    ratio = period / float(np.median(np.diff(stamps)))
    return is_steady(steps, period) and not 1.0 / _SAME_RHYTHM < ratio < _SAME_RHYTHM


def _keep_last_epoch(series: dict[Topic, Series], master: Topic, warnings: list[str]) -> int | None:
    """Drop what came before the last reset of the plant; return when that arrived, if any did."""
    plant = series[master]
    resets = _resets(plant.stamps)
    if not resets:
        return None
    start, times = resets[-1], len(resets)
    before, after = seconds(int(plant.stamps[start - 1])), seconds(int(plant.stamps[start]))
    warnings.append(
        f"the clock went back {times} time{'s' if times > 1 else ''}, last from {before:.12g} s "
        f"to {after:.12g} s (plant reset or restarted); only what follows is read"
    )
    for topic, messages in series.items():
        firsts = np.searchsorted(messages.arrival, plant.arrival[resets])
        first = int(firsts[-1])
        if first:  # two that answer at once, one of them late, make a topic go back elsewhere too
            own = np.array(_resets(messages.stamps), np.int64)
            # A rare topic need not go back at every reset: jumps near an earlier one do not count.
            nearer = firsts[firsts < first][-1:]
            own = own[(2 * own > first + nearer) if nearer.size else slice(None)]
            if own.size:
                first = int(own[np.abs(own - first).argmin()])
            elif (  # sent with the first state, and before it
                messages.stamps[first - 1] <= plant.stamps[start]
                and messages.arrival[first - 1] > plant.arrival[start - 1]
            ):
                first -= 1
        series[topic] = messages[first:]
    return int(plant.arrival[start])


def _resets(stamps: Integers) -> list[int]:
    """Index of the first message after each backward jump, found in one pass."""
    if not (k := _first_jump(stamps)):
        return []
    found = [k]
    told, newest, late = stamps.tolist(), stamps[k], 0
    while k < len(told):
        late = late + 1 if told[k] < newest else 0
        newest = max(newest, told[k])
        if late > _LONGEST_DELAY:
            k -= _LONGEST_DELAY
            found.append(k)
            newest, late = told[k], 0
        k += 1
    return found


def _first_jump(stamps: Integers) -> int:
    """Index of the first message after the first backward jump; 0 if there is none."""
    newest = np.maximum.accumulate(stamps)
    late = np.concatenate([[False], stamps[1:] < newest[:-1], [False]])
    borders = np.flatnonzero(np.diff(late.astype(np.int8)))
    first, last = borders[::2] + 1, borders[1::2] + 1
    jumps = first[last - first > _LONGEST_DELAY]
    return int(jumps[0]) if len(jumps) else 0


def _without_leaps(topic: Topic, messages: Series, warnings: list[str]) -> Series:
    """Leave out a few messages whose stamps leap ahead, if those that follow go on as before.

    What follows a reset begins before what came last; what follows a wrong stamp does not.
    """
    kept, start = np.arange(len(messages.stamps)), 0
    for _ in range(_MOST_LEAPS):
        jump = _first_jump(messages.stamps[kept[start:]])
        if not jump:
            break
        start += jump
        before = messages.stamps[kept[max(start - _LONGEST_DELAY - 1, 0) : start]]
        ahead = np.flatnonzero(before > messages.stamps[kept[start]])
        if len(ahead) < len(before):
            kept = np.delete(kept, start - len(before) + ahead)
            start = 0
    left_out = len(messages.stamps) - len(kept)
    if not left_out:
        return messages
    warnings.append(f"{left_out} messages of {topic.name} have stamps that leap ahead: left out")
    return messages[kept]


def _in_order(topic: Topic, messages: Series, warnings: list[str]) -> Series:
    """Sort by stamp; of several messages with one stamp keep the first, on which others acted.

    What is sent again in lock-step has the same numbers.
    """
    steps = np.diff(messages.stamps)
    if (steps > 0).all():
        return messages
    late = int((steps < 0).sum())
    if late:
        warnings.append(f"{late} messages of {topic.name} arrived out of order")
    _, first, place = np.unique(messages.stamps, return_index=True, return_inverse=True)
    again = messages.values[first[place]]
    alike = (messages.values == again) | (np.isnan(messages.values) & np.isnan(again))
    if others := int(np.count_nonzero(~alike.all(axis=1))):
        warnings.append(
            f"{others} messages of {topic.name} have the stamp of an earlier one and other "
            "numbers: left out"
        )
    return messages[first]


def _complete(
    stamps: Integers, rate: float | None, most: int, warnings: list[str]
) -> tuple[Integers, int]:
    """Fill up to `most` gaps of the plant's stamps; the second number is how many are left."""
    steps = np.diff(stamps)
    if len(steps) == 0:
        return stamps, 0
    period = NANOSECONDS / rate if rate else float(np.median(steps))
    lost = np.maximum(np.rint(steps / period).astype(np.int64) - 1, 0)
    # A message that is only late makes a step beside it shorter.
    three = np.convolve(np.pad(steps, 1, constant_values=round(period)), [1, 1, 1], "valid")
    lost = np.minimum(lost, np.maximum(np.rint(three / period).astype(np.int64) - 3, 0))
    total = int(lost.sum())
    if rate is None and not is_steady(steps, period):
        return _with_breaks(stamps, warnings), 0
    if total == 0:
        return stamps, 0
    if total > most:
        warnings.append(
            f"{total} of {total + len(stamps)} instants are missing and left out of the record"
        )
        return stamps, total
    before = np.repeat(np.arange(len(lost)), lost)
    place = np.arange(total) - np.repeat(np.cumsum(lost) - lost, lost) + 1
    between = stamps[before] + np.rint(place * (steps / (lost + 1))[before]).astype(np.int64)
    if rate:
        between = _on_grid(between, rate, stamps)
    return np.sort(np.concatenate([stamps, between])), 0


def _with_breaks(stamps: Integers, warnings: list[str]) -> Integers:
    """Put an instant without samples into each long step, where steps vary."""
    steps = np.diff(stamps)
    low, high = (seconds(int(each)) for each in (steps.min(), steps.max()))
    warnings.append(
        f"the steps between instants vary from {low:g} to {high:g} s, so nobody knows whether "
        "messages are missing"
    )
    usual = int(np.quantile(steps, USUAL))
    breaks = stamps[:-1][steps > LONGEST * usual]
    return np.sort(np.concatenate([stamps, breaks + usual]))


def _on_grid(between: Integers, rate: float, stamps: Integers) -> Integers:
    """Stamps as the plant would have rounded them (`science.stamps.stamp_of`), if it does so."""

    def rounded(instants: Integers) -> Integers:
        steps = np.rint(instants * (rate / NANOSECONDS))
        grid: Integers = np.rint(steps * NANOSECONDS / rate).astype(np.int64)
        return grid

    return rounded(between) if np.array_equal(rounded(stamps), stamps) else between


def _without_ragged_end(stamps: Integers, series: Mapping[Topic, Series], most: int) -> Integers:
    """Drop up to `most` last instants that lack messages."""
    ends = [
        each.stamps[-1] for topic, each in series.items() if each.stamps.size and not topic.late
    ]
    complete = int(np.searchsorted(stamps, min(ends, default=stamps[-1]), side="right"))
    return stamps[: max(complete, len(stamps) - most, 1)]


def _spread(messages: Series, stamps: Integers) -> tuple[Array, int, int]:
    """Column on the timeline, number of instants without message, and of messages off it."""
    if np.array_equal(messages.stamps, stamps):
        return messages.values, 0, 0
    place, inside = _places(messages.stamps, stamps)
    column = np.full((len(stamps), messages.values.shape[1]), np.nan)
    column[place[inside]] = messages.values[inside]
    strays = ~inside & (messages.stamps <= stamps[-1])
    return column, len(stamps) - int(inside.sum()), int(strays.sum())


def _places(own: Integers, stamps: Integers) -> tuple[Integers, NDArray[np.bool_]]:
    """Where each own stamp lies among others in order, and whether it is one of them."""
    place = np.searchsorted(stamps, own)
    inside = place < len(stamps)
    inside[inside] = stamps[place[inside]] == own[inside]
    return place, inside


def _union(ordered: list[Integers]) -> Integers:
    """Every stamp once, in order; `np.unique` would hash them, which takes far longer."""
    stamps = np.sort(np.concatenate(ordered), kind="stable")
    return stamps[np.flatnonzero(np.diff(stamps, prepend=stamps[:1] - 1))]
