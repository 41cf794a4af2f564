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

"""Bags of a plant of one's own, of hardware, or of some topics only: read as far as they go."""

import csv
from collections.abc import Callable
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_helpers import TYPES, header, imu, messages, quaternion, serialised, vector, write_messages
from conftest import Ask
from synthetic import SAMPLED, normal_run, requirement, without_columns

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.verdict import NOT_JUDGED
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run, read_runs
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import CONTROLLER
from ppc_attitude.processes.exits import BAD_INPUT

RUN = normal_run(duration=1.0)
OWN_PLANT = ("attitude", "angular_velocity", "torque_command")
MAPPED = {"attitude": "/imu/data", "angular_velocity": "/imu/data"}


def head(stamp: int) -> Any:
    return header(stamp, f"imu{stamp % 3}")


def measured(stamp: int, q: Any, rate: Any, covariance: float = 0.0) -> Any:
    zero = [0.0] * 9
    orientation = q, [covariance, *zero[1:]]
    return imu(head(stamp), orientation, (rate, zero), ((0.0, 0.0, 9.81), zero))


def pose(attitude: Any) -> Any:
    point = TYPES["geometry_msgs/msg/Point"](1.0, 2.0, 3.0)
    return TYPES["geometry_msgs/msg/Pose"](position=point, orientation=quaternion(attitude))


def write_typed(path: Path, typed: list[tuple[str, int, Any]]) -> Path:
    """Messages by absolute topic, receive time and content, in either byte order."""
    with BagWriter(path) as writer:
        for topic, msgtype in {topic: m.__msgtype__ for topic, _, m in typed}.items():
            writer.add_topic(topic, msgtype)
        for k, (topic, time, m) in enumerate(typed):
            writer.write(topic, time, serialised(m, little_endian=k % 3 > 0))
    return path


def only(run: RunRecord, *columns: str) -> RunRecord:
    return without_columns(run, *(set(run.columns) - set(columns)))


def rows(run: RunRecord, column: str) -> list[tuple[int, list[float]]]:
    return list(zip(run.stamps_ns.tolist(), run[column].tolist(), strict=True))


def why(path: Path, **options: Any) -> dict[str, str]:
    """Key of a requirement that is not judged to the reason."""
    verdict = Verdict(read_run(path, **options))
    assert verdict.all_met
    return {each.key: each.note for each in verdict.requirements if each.outcome == NOT_JUDGED}


def test_a_plant_of_ones_own_with_our_law_is_judged_by_what_it_sends(tmp_path: Path) -> None:
    """What the how-to asks for: the reference and the law are ours, the plant is not."""
    law = [topic.column for topic in SAMPLED if topic.source == CONTROLLER]
    reference = ("reference_attitude", "reference_angular_velocity")
    run = only(normal_run(rate=10.0), *OWN_PLANT, *reference, *law)
    ours = {CONTROLLER: run.parameters[CONTROLLER]}
    write_run(replace(run, parameters=ours), tmp_path / "bag")
    read = read_run(tmp_path / "bag", whole=True)
    assert (read.warnings, read.missing) == ((), {})
    verdict = Verdict(read)
    outcomes = {each.key: each.outcome for each in verdict.requirements}
    assert outcomes["settling_time"] == outcomes["rate"] == "met"
    assert why(tmp_path / "bag") == {"applied_torque": "no topic applied_torque in the bag"}


@pytest.mark.parametrize(("column", "width"), [("reference_attitude", 4), ("star_fix", 7)])
def test_a_bag_without_anything_of_a_plant_is_read(tmp_path: Path, column: str, width: int) -> None:
    run = replace(RUN, columns={column: np.ones((len(RUN.t), width))})
    read = read_run(write_messages(tmp_path / "bag", list(messages(run))))
    assert read[column].shape == (len(RUN.t), width)


KINDS: dict[str, Callable[[int, Any], Any]] = {
    "imu": lambda stamp, q: measured(stamp, q, (0.0, 0.0, 0.0)),
    "pose": lambda _, q: pose(q),
    "stamped pose": lambda stamp, q: TYPES["geometry_msgs/msg/PoseStamped"](head(stamp), pose(q)),
    "pose with covariance": lambda stamp, q: TYPES["geometry_msgs/msg/PoseWithCovarianceStamped"](
        head(stamp), TYPES["geometry_msgs/msg/PoseWithCovariance"](pose(q), np.zeros(36))
    ),
    "quaternion": lambda _, q: quaternion(q),
    "header that nobody fills": lambda _, q: TYPES["geometry_msgs/msg/QuaternionStamped"](
        head(0), quaternion(q)
    ),
    "header that is filled once": lambda _, q: measured(777, q, (0.0, 0.0, 0.0)),
}
UNSTAMPED = {
    **dict.fromkeys(("pose", "quaternion", "header that nobody fills"), "no stamps"),
    "header that is filled once": "one stamp for all messages",
}


@pytest.mark.parametrize("kind", KINDS)
def test_an_attitude_of_hardware(tmp_path: Path, kind: str) -> None:
    """With another type and name, with or without stamps: then it counts when it was received."""
    sent = [("/mocap", stamp, KINDS[kind](stamp, q)) for stamp, q in rows(RUN, "attitude")]
    read = read_run(write_typed(tmp_path / "bag", sent), topics={"attitude": "/mocap"})
    np.testing.assert_array_equal(read.stamps_ns, RUN.stamps_ns)
    np.testing.assert_array_equal(read["attitude"], RUN["attitude"])
    told = [each for each in read.warnings if "the times of receipt are taken" in each]
    said = f"/mocap has {UNSTAMPED.get(kind)}: the times of receipt are taken"
    assert told == ([said] if kind in UNSTAMPED else [])


def test_equal_messages_with_one_stamp_are_one_and_this_is_told(tmp_path: Path) -> None:
    """A craft at rest whose driver fills no header was one instant without a word."""
    sent = [("/imu/data", k, measured(7, (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0))) for k in range(30)]
    read = read_run(write_typed(tmp_path / "bag", sent), topics=MAPPED)
    assert read.stamps_ns.tolist() == [7]
    assert read.warnings[0] == "30 equal messages of /imu/data have one stamp: one counts"
    assert "/imu/data" not in "".join(read.warnings[1:])


def test_a_constant_beside_an_attitude_without_stamps_counts_at_its_receipt_too(
    tmp_path: Path,
) -> None:
    """It counted as one message of the year 1970."""
    unstamped = KINDS["header that nobody fills"]
    sent = [("/mocap", stamp, unstamped(stamp, q)) for stamp, q in rows(RUN, "attitude")]
    straight = (0.0, 0.0, 0.0, 1.0)
    sent += [("/goal", stamp, unstamped(0, straight)) for stamp in RUN.stamps_ns.tolist()]
    names = {"attitude": "/mocap", "reference/attitude": "/goal"}
    read = read_run(write_typed(tmp_path / "bag", sent), topics=names)
    assert (read["reference_attitude"] == straight).all()
    told = [f"{name} has no stamps: the times of receipt are taken" for name in ("/mocap", "/goal")]
    assert [each for each in read.warnings if "stamp" in each] == told


def test_a_constant_beside_a_rate_without_stamps_keeps_its_stamp(tmp_path: Path) -> None:
    """The attitude tells if a run has stamps, and no other topic."""
    sent = [("/mocap", stamp, KINDS["imu"](stamp, q)) for stamp, q in rows(RUN, "attitude")]
    still = TYPES["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    sent += [("/rate", stamp, still) for stamp in RUN.stamps_ns.tolist()]
    sent.append(("/goal", 10**9, KINDS["stamped pose"](0, (0.0, 0.0, 0.0, 1.0))))
    names = {"attitude": "/mocap", "angular_velocity": "/rate", "reference/attitude": "/goal"}
    told = read_run(write_typed(tmp_path / "bag", sent), topics=names).warnings
    by_receipt = [each.split()[0] for each in told if "times of receipt" in each]
    assert by_receipt == ["/rate"]


def test_one_imu_gives_attitude_and_rate(tmp_path: Path) -> None:
    both = zip(rows(RUN, "attitude"), RUN["angular_velocity"].tolist(), strict=True)
    sent = [("/imu/data", 5, measured(stamp, q, w)) for (stamp, q), w in both]
    read = read_run(write_typed(tmp_path / "bag", sent), topics=MAPPED)
    np.testing.assert_array_equal(read["attitude"], RUN["attitude"])
    np.testing.assert_array_equal(read["angular_velocity"], RUN["angular_velocity"])


def test_an_imu_without_orientation_and_a_quaternion_of_zeros_are_no_attitude(
    tmp_path: Path,
) -> None:
    sent = [
        ("/imu/data", 1, measured(0, (0, 0, 0, 1), (1, 2, 3))),
        ("/imu/data", 2, measured(10, (0, 0, 0, 1), (1, 2, 3), covariance=-1.0)),
        ("/imu/data", 3, measured(20, (0, 0, 0, 0), (1, 2, 3))),
        ("/imu/data", 4, measured(30, (0, 0, 1, 0), (1, 2, 3))),
    ]
    read = read_run(write_typed(tmp_path / "bag", sent), "/craft", topics=MAPPED)
    assert (
        "2 messages of /imu/data have no readable value, or a stamp below 0: left out"
        in read.warnings
    )
    assert np.isfinite(read["attitude"]).all(axis=1).tolist() == [True, False, False, True]
    assert np.isfinite(read["angular_velocity"]).all()


def test_topics_with_stamps_of_their_own_are_held(tmp_path: Path) -> None:
    """A goal that is sent thrice, and a gyro that is not in step: the latest message counts."""
    at, straight = range(3_000_000, 10**9, 10_000_000), (0.0, 0.0, 0.0, 1.0)
    sent = [("/gyro", time, vector((1.0 * k, 0.0, 0.0))) for k, time in enumerate(at)]
    sent += [("/attitude", s, KINDS["quaternion"](s, q)) for s, q in rows(RUN, "attitude")]
    sent += [("/goal", 500_000_001 + again, quaternion(straight)) for again in range(3)]
    sent += [("/truth", 1, quaternion(straight)), ("/torque", 10**10, vector((0.0, 0.0, 0.0)))]
    names = {"angular_velocity": "/gyro", "reference/attitude": "/goal"}
    names |= {"truth/attitude": "/truth", "torque_command": "/torque"}
    read = read_run(write_typed(tmp_path / "bag", sent), topics=names)
    np.testing.assert_array_equal(read.stamps_ns, RUN.stamps_ns)
    assert np.nanmax(np.abs(np.diff(read["angular_velocity"][1:, 0]))) == 1.0
    assert np.isnan(read["reference_attitude"][:51]).all()
    assert (read["reference_attitude"][51:] == straight).all()
    assert (read["truth_attitude"][1:] == straight).all()
    assert any("at most 0.5 s old" in each or "0.499999" in each for each in read.warnings)
    assert "torque_command begins after the last instant of attitude" in read.warnings
    assert (requirement(Verdict(read), "lost_messages").value, read.missing) == (0.0, {})


def slow(path: Path, column: str, own: str, begin: float, end: float) -> Verdict:
    """Judge an attitude, its reference and a column that has the numbers of an own one.

    It comes at 20 Hz with stamps of its own, from one instant to another [s].
    """
    run = normal_run()
    sent = list(messages(only(run, "attitude", *({"reference_attitude"} - {column}))))
    at = (run.stamps_ns % 50_000_000 == 0) & (begin <= run.t) & (run.t <= end)
    stamps, rows = run.stamps_ns[at] + 3_000_000, run[own][at]
    late = replace(run, stamps_ns=stamps, columns={column: rows})
    path = write_messages(path, sorted([*sent, *messages(late)], key=itemgetter(1)))
    return Verdict(read_run(path))


def test_nothing_is_said_of_an_error_before_its_reference_begins(tmp_path: Path) -> None:
    verdict = slow(tmp_path / "bag", "reference_attitude", "reference_attitude", 70.0, 120.0)
    settling, error = (
        requirement(verdict, key) for key in ("settling_time", "error_after_deadline")
    )
    assert (settling.met, verdict.metrics.settling_time_s) == (None, None)
    assert settling.reason == "the record of the error begins at 70.01 s, after the deadline"
    assert (error.met, error.span) == (True, (70.01, 120.0))


def test_a_truth_that_ends_is_not_held_for_ever(tmp_path: Path) -> None:
    verdict = slow(tmp_path / "bag", "truth_attitude", "attitude", 0.0, 80.0)
    assert requirement(verdict, "terminal_error").outcome == NOT_JUDGED
    # From half a second, ten of its steps, after the last one on.
    assert requirement(verdict, "lost_messages").value == pytest.approx(100 * 39.5, abs=2)


@pytest.mark.parametrize(("attitude", "rate", "goal"), [(1, 1, 20), (2, 1, 50), (1, 2, 200)])
def test_topics_at_rates_that_divide_each_other_are_held(
    tmp_path: Path, attitude: int, rate: int, goal: int
) -> None:
    """Every n-th stamp of a 100 Hz clock: a slow topic lacks nothing, a fast one adds no instant.

    The goal of the last case comes once, at the begin.
    """
    taken = {"attitude": attitude, "angular_velocity": rate, "reference_attitude": goal}
    sent = [
        (topic, stamp, data)
        for topic, stamp, data in messages(only(RUN, *taken))
        if stamp % (taken[topic.column] * int(RUN.stamps_ns[1])) == 0
    ]
    path = write_messages(tmp_path / "bag", sent)
    read = read_run(path)
    np.testing.assert_array_equal(read.stamps_ns, RUN.stamps_ns[::attitude])
    assert read.missing == {}
    latest = np.arange(0, len(RUN.t), attitude)
    for column, step in taken.items():
        np.testing.assert_array_equal(read[column], RUN[column][latest // step * step])
    assert any("reference/attitude has stamps of its own" in each for each in read.warnings)
    # What came between two instants of a slower attitude, such as the largest rate, is not judged.
    told = [each.partition("old; ")[2] for each in read.warnings if "are not used" in each]
    assert told == (["50 others are not used"] if attitude == 2 else [])


def test_a_clock_that_jitters_has_the_gaps_that_are_there(tmp_path: Path) -> None:
    """Now and then a message is 0.6 to 0.9 of a period late; 30 are lost in a row, and one."""
    random = np.random.default_rng(3)
    stamps = RUN.stamps_ns + random.normal(scale=3e5, size=len(RUN.t)).astype(np.int64)
    stamps[10:90:16] += random.integers(6_000_000, 9_000_000, 5)
    kept = np.r_[0:40, 70:95, 96:101]
    read = read_with(tmp_path / "bag", stamps[kept], RUN["attitude"][kept])
    assert read.missing == {"attitude": 31}
    assert np.isin(stamps[kept], read.stamps_ns).all()


def read_with(bag: Path, stamps: np.ndarray, attitude: np.ndarray) -> RunRecord:
    run = replace(RUN, stamps_ns=stamps, columns={"attitude": attitude}, parameters={})
    write_run(run, bag)
    return read_run(bag)


def test_a_plant_in_any_rhythm_has_no_gaps(tmp_path: Path) -> None:
    stamps = 10_000_000 * np.cumsum([0, *[1, 3, 1, 3, 1] * 20])
    read = read_with(tmp_path / "bag", stamps, RUN["attitude"])
    np.testing.assert_array_equal(read.stamps_ns, stamps)
    assert read.missing == {}
    assert "nobody knows whether messages are missing" in read.warnings[0]


def test_a_plant_in_any_rhythm_may_have_a_break(tmp_path: Path) -> None:
    stamps = 10_000_000 * np.cumsum([0, *[1, 3, 1, 3, 1] * 10, 31, *[3, 1, 3, 1] * 12, 1])
    read = read_with(tmp_path / "bag", stamps, RUN["attitude"])
    assert read.missing == {"attitude": 1}
    assert np.flatnonzero(np.isnan(read["attitude"][:, 0])).tolist() == [51]
    assert read.stamps_ns[50:53].tolist() == [stamps[50], stamps[50] + 30_000_000, stamps[51]]


def test_what_is_asked_for_and_missing_is_an_error(tmp_path: Path) -> None:
    sent = [("/imu", s, measured(s, q, (0, 0, 0))) for s, q in rows(RUN, "attitude")]
    bag = write_typed(tmp_path / "bag", sent)
    with pytest.raises(BagError, match=r"has no topic /imuu for attitude; it holds /imu \(sensor"):
        read_run(bag, topics={"attitude": "imuu"})
    with pytest.raises(BagError, match=r"has no topic /imuu for attitude; it holds /imu \(sensor"):
        read_runs(bag, topics={"attitude": "imuu"})
    ours = write_messages(tmp_path / "ours", list(messages(RUN)))
    with pytest.raises(BagError, match=r"has no topic /imuu for attitude; it holds /angular"):
        read_run(ours, topics={"attitude": "imuu"})  # the own attitude is not what was asked for
    with pytest.raises(BagError, match="a run has no topic altitude with samples; allowed: "):
        read_run(bag, topics={"altitude": "/imu"})
    with pytest.raises(
        BagError, match=r"/imu cannot be read as torque_command: its type is sensor_msgs/msg/Imu"
    ):
        read_run(bag, topics={"torque_command": "/imu"})
    told = r"it holds /imu .* say which topic carries .*--topic attitude=/imu/data"
    with pytest.raises(BagError, match=told):
        read_run(bag)


def test_two_partial_runs_in_one_bag_are_told_apart(tmp_path: Path) -> None:
    part = only(RUN, "attitude", "reference_attitude")
    bag = write_messages(tmp_path / "bag", list(messages(part)), namespaces=("/a", "/b"))
    assert len(read_runs(bag)) == 2
    with pytest.raises(BagError, match="holds 2 runs; choose a namespace: /a, /b"):
        read_run(bag)
    with pytest.raises(BagError, match="holds 2 runs; choose a namespace: /a, /b"):
        read_runs(bag, topics={"attitude": "/a/attitude"})


@pytest.mark.usefixtures("undrawn")
def test_the_commands_take_bags_of_hardware(tmp_path: Path, ask: Ask) -> None:
    """A minute of an Imu and a goal, as a driver records them."""
    run = normal_run(duration=70.0, rate=10.0)
    both = zip(rows(run, "attitude"), run["angular_velocity"].tolist(), strict=True)
    sent = [("/imu/data", stamp, measured(stamp, q, w)) for (stamp, q), w in both]
    goals = rows(run, "reference_attitude")
    sent += [("/goal", stamp, KINDS["stamped pose"](stamp, q)) for stamp, q in goals]
    hardware = write_typed(tmp_path / "bag", sent)
    topics = [f"--topic={ours}=/imu/data" for ours in MAPPED] + ["--topic=reference/attitude=/goal"]
    page, table = tmp_path / "run.html", tmp_path / "run.csv"
    told = ask("analyse", hardware, *topics, "--report", page, "--json").json
    by_name = {each["name"]: each for each in told["requirements"]}
    assert by_name["settling time"]["pass"] and by_name["angular rate (norm)"]["pass"]
    assert by_name["applied torque on an axis"]["reason"] == "no topic applied_torque in the bag"
    assert "no topic applied_torque in the bag" in page.read_text()
    ask("export", hardware, *topics, "--csv", table)
    with table.open() as file:
        head = next(csv.reader(file))
    assert head[2:9] == [f"attitude_{k}" for k in "xyzw"] + [f"angular_velocity_{k}" for k in "xyz"]
    ours = tmp_path / "ours"
    write_run(run, ours)
    compared = tmp_path / "compared.html"
    outputs = ["--report", compared, "--figures", tmp_path]
    said = ask("compare", hardware, ours, *topics, *outputs).err
    assert f"warning: {ours}: there is no topic /imu/data: /attitude is read for attitude" in said
    assert f"warning: comparison_rate_error is not drawn: {hardware}: the record has no" in said
    assert "Pointing errors" in compared.read_text()
    refused = ask("analyse", hardware, *topics, "--topic=attitude=/goal", code=BAD_INPUT).err
    assert refused == "error: --topic attitude = /imu/data and /goal; allowed: one\n"
    assert "the parameters of its nodes" in ask("replay", hardware, *topics, code=BAD_INPUT).err


@pytest.mark.usefixtures("undrawn")
def test_a_bag_with_nothing_but_an_attitude_has_a_report(tmp_path: Path, ask: Ask) -> None:
    bag = write_messages(tmp_path / "bag", list(messages(only(RUN, "attitude"))))
    page = tmp_path / "run.html"
    ask("analyse", bag, "--report", page, "--figures", tmp_path)
    assert (tmp_path / "attitude.png").exists()
    assert "no topic reference/attitude in the bag" in page.read_text()
    ask("compare", bag, bag, "--report", tmp_path / "two.html")
