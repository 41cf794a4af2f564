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

"""Replay finds no difference in a run of ours, whatever was changed in flight."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import configs
from docs_helpers import described
from synthetic import part_of, with_columns, with_parameters, without_columns

from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.run_record import Change, RunRecord
from ppc_attitude.contract.topics import ATTITUDE, CONTROLLER, ENABLED, ESTIMATOR, PLANT, REFERENCE
from ppc_attitude.nodes.messages import Inbox
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.sensors.gyro_star_tracker import STAR_FIX
from ppc_attitude.science.sensors.star_tracker import check_slots
from ppc_attitude.science.stamps import nanoseconds, stamp_of
from ppc_attitude.simulation.closed_loop import by_column, simulate, stamps_of
from ppc_attitude.simulation.diagram import Diagram
from ppc_attitude.simulation.replay import replay
from ppc_attitude.simulation.scenario import Scenario, load, scenario

NOISY = {"spacecraft_plant": {"attitude_noise": 1e-4, "rate_noise": 1e-5, "seed": 2}}


@kernel
def _gives_nan(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    outputs.torque_command[:] = np.nan


def differing(record: RunRecord) -> set[str]:
    return {each.component for each in replay(record).found if each.largest > 0.0}


@pytest.mark.parametrize("given", [{}, NOISY], ids=["exact", "noisy"])
def test_every_component_gives_again_what_is_on_record(given: dict[str, dict[str, float]]) -> None:
    found = replay(simulate(scenario(given), 5.0))
    names = [each.component for each in found.found]
    assert names == ["ppc", "rigid_body", "direct", "ideal", "paper"]
    assert all(each.largest == 0.0 for each in found.found)
    assert {(each.steps, each.skipped) for each in found.found} == {(501, 0)}


def test_an_environment_gives_again_what_it_tells_of_itself() -> None:
    """Its torque is on record in the sum with what is injected only."""
    record = simulate(load(configs("paper", "orbit")), 2.0)
    assert "orbit" in {each.component for each in replay(record).others}
    assert not differing(record)
    for name in ("orbit_position", "sun"):
        rows = record[name].copy()
        rows[77, 1] += 1e-3
        found = replay(with_columns(record, **{name: rows})).others
        assert [(each.column, each.at) for each in found if each.largest > 0.0] == [(name, 0.77)]


def estimated(**tracker: float) -> Scenario:
    """A run on an estimate whose fixes are late, absent at times, and false at times."""
    files = configs("paper", "sensors_cubesat")
    faults = {"dropout_probability": 0.2, "outlier_probability": 0.1, "outlier_size": 0.05}
    given = {f"star_tracker.{name}": value for name, value in {**faults, **tracker}.items()}
    plant = {**given, "seed": 5, "initial_fix": False}
    return load(files, {PLANT: plant, ESTIMATOR: {"initial_fix": False}})


def test_an_estimator_gives_again_what_late_fixes_made_it_give() -> None:
    record = simulate(estimated(), 12.0)
    refused = np.square(record["innovation"]).sum(axis=1) > 25.0
    assert refused.sum() >= 3
    found = replay(record)
    components = [each.component for each in found.others]
    assert {"gyro_star_tracker", "mekf"} <= set(components)
    assert all(each.largest == 0.0 for each in found.found)
    assert {(each.steps, each.skipped) for each in found.found} == {(1201, 0)}
    fixes = record["star_fix"].copy()
    fixes[200, 0] += 1e-6
    assert differing(with_columns(record, star_fix=fixes)) == {"gyro_star_tracker", "mekf"}


def test_an_estimator_without_a_fix_is_replayed_too() -> None:
    """Fixes and innovations of a run that is shorter than the latency are on no record."""
    tracker = {"star_tracker.latency": 9.0, "initial_fix": False}
    case = load(configs("paper", "sensors_cubesat"), {PLANT: tracker, ESTIMATOR: tracker})
    record = simulate(case, 1.0)
    assert not record.columns.keys() & {"innovation", "star_fix"}
    assert {"gyro_star_tracker", "mekf"} < {each.component for each in replay(record).others}
    assert not differing(record)


def test_what_cannot_be_replayed_is_named_with_the_reason() -> None:
    record = simulate(estimated(), 1.0)
    reason = replay(without_columns(record, "gyro")).left_out[0]
    assert reason.startswith("gyro_star_tracker: no messages of ")
    noisy = without_columns(simulate(scenario(NOISY), 0.1), "truth_attitude")
    lacks = [f"{each}: no messages of truth/attitude" for each in ("rigid_body", "direct")]
    assert [*replay(noisy).left_out] == lacks, "what was told with noise is not the truth"


@pytest.mark.parametrize("since", [0, 5])
def test_a_motion_is_not_integrated_from_1970_to_the_stamps_of_the_wall_clock(since: int) -> None:
    record = simulate(scenario({}), 0.1)
    stamps = record.stamps_ns.copy()
    stamps[since:] += nanoseconds(1.8e9)
    found = replay(replace(record, stamps_ns=stamps))
    assert found.left_out[0].startswith("paper: stamps go on to 1.8e+09 s; allowed: up to 1e+08 s")
    assert [each.component for each in found.found] == ["ppc", "rigid_body", "direct", "ideal"]


def test_instants_without_a_command_on_record_are_skipped() -> None:
    record = simulate(scenario({}), 0.5)
    torque = record["torque_command"].copy()
    torque[[3, 7]] = np.nan
    law = replay(with_columns(record, torque_command=torque)).law
    assert law is not None
    assert (law.steps, law.skipped) == (49, 2)
    torque[:] = np.nan
    with pytest.raises(ConfigurationError, match="no instant has all inputs and all outputs"):
        replay(with_columns(record, torque_command=torque))


def test_a_law_is_given_the_attitudes_to_which_its_node_normalises() -> None:
    """An IMU's float32 attitudes gave a difference of 1e-16 N·m, and exit code 1."""
    sent = simulate(scenario({}), 2.0)
    sent = with_columns(sent, attitude=sent["attitude"].astype(np.float32).astype(np.float64))
    inbox, codec = Inbox(ATTITUDE), Codec(ATTITUDE)
    taken = [inbox.read(codec.encode(0, row)).values for row in sent["attitude"].tolist()]
    assert replay(sent).law == replay(with_columns(sent, attitude=np.array(taken))).law


def test_what_a_plant_computed_that_ran_free_is_not_replayed() -> None:
    record = simulate(scenario({}), 0.5)
    found = replay(with_parameters(record, PLANT, {"lockstep": False}))
    assert [each.component for each in found.found] == ["ppc", "direct", "paper"]
    why = "the plant ran free (lockstep = false): no stamp tells which inputs a step had"
    assert found.left_out == (f"rigid_body: {why}", f"ideal: {why}")


def test_a_law_without_its_parameters_or_messages_is_an_error() -> None:
    record = simulate(scenario({}), 0.1)
    plant = {PLANT: record.parameters[PLANT]}
    with pytest.raises(ConfigurationError, match=f"has no parameters of {CONTROLLER}"):
        replay(replace(record, parameters=plant))
    with pytest.raises(ConfigurationError, match="no messages of angular_velocity, torque_command"):
        replay(without_columns(record, "angular_velocity", "torque_command"))


def test_fixes_at_other_times_than_the_estimator_says_are_not_replayed() -> None:
    """Nothing tells when they arrived."""
    record = simulate(estimated(), 1.0)
    changed = with_parameters(record, ESTIMATOR, {"star_tracker.rate": 7.0})
    left_out = replay(changed).left_out
    told = "came at other times than parameters of attitude_estimator say"
    assert left_out == (f"mekf: star_tracker/attitude {told}",)


def test_an_estimator_is_replayed_past_a_fix_of_an_instant_that_is_not_on_record() -> None:
    record = simulate(estimated(), 2.0)
    instants = np.delete(np.arange(record.stamps_ns.size), 100)
    found = replay(part_of(record, instants))
    (mekf_alone,) = (each for each in found.others if each.component == "mekf")
    assert mekf_alone.skipped == 1


def test_an_estimator_is_not_replayed_without_a_fix_that_was_due() -> None:
    """Sensors that give none where they see nothing are not told from a message that was lost."""
    record = simulate(estimated(), 2.0)
    fixes = record["star_fix"].copy()
    fixes[100] = np.nan
    lost = with_columns(record, star_fix=fixes)
    found = replay(lost)
    assert found.left_out == (
        "mekf: no message of star_tracker/attitude at 1 s, where one was due",
    )
    assert all(each.largest == 0.0 for each in found.found)
    arrives = 100 + round(100.0 * record.parameters[ESTIMATOR]["star_tracker.latency"])
    cut = part_of(lost, slice(arrives + 1))  # where a recorder was stopped any message may lack
    mekf_alone = next(each for each in replay(cut).others if each.component == "mekf")
    assert (mekf_alone.largest, mekf_alone.skipped) == (0.0, 1)


def test_a_component_that_differs_without_a_value_on_record_is_left_out() -> None:
    """As one of another version of its package, whose range excludes the value on record."""
    for gate, differs in ((mekf.COMPONENT.defaults["gate"], False), (2.0, True)):
        record = simulate(estimated().with_values(ESTIMATOR, gate=gate), 12.0)
        values = dict(record.parameters[ESTIMATOR])
        del values["gate"]
        found = replay(replace(record, parameters={**record.parameters, ESTIMATOR: values}))
        reason = "mekf: innovation differs by up to 416, with the defaults of gate, "
        assert [each.startswith(reason) for each in found.left_out] == [True] * differs
        assert all(each.largest == 0.0 for each in found.found)


def test_an_estimator_of_two_late_columns_or_of_one_alone_is_for_the_loop_alone() -> None:
    told = replace(STAR_FIX, name="told", topic="told")
    for inputs, names in (((*mekf.COMPONENT.inputs, told), "star_fix, told"), ((told,), "told")):
        with pytest.raises(ConfigurationError, match=f"mekf reads late {names}; allowed between n"):
            check_slots(replace(mekf.COMPONENT, inputs=inputs))


def changed_in_flight(
    before: Scenario, step: int, end: int, changes: tuple[Change, ...], **parts: str
) -> RunRecord:
    """Run of a loop whose parts, each with its node, get other numbers before a step."""
    stamps = stamps_of(100.0, end / 100.0)
    diagram = Diagram(before.parameters)
    early = diagram.run(stamps[:step])
    values = {node: dict(own) for node, own in before.parameters.items()}
    for change in changes:
        values[change.node][change.name] = change.value
    for part, node in parts.items():
        diagram.parts[part].configure(values[node])
        if part == "references":  # as its node does: it has no past
            diagram.parts[part].forget()
    late = diagram.run(stamps[step:])
    columns = by_column(diagram.columns, stamps, np.concatenate([early, late], axis=1))
    parameters = before.with_values(PLANT, lockstep=True).parameters
    return RunRecord("simulate", "ppc", stamps, columns, parameters=parameters, changes=changes)


def test_a_gate_that_was_changed_in_flight_is_applied_at_its_stamp() -> None:
    change = Change(stamp_of(600, 100.0), ESTIMATOR, "gate", 4.0)
    record = changed_in_flight(estimated(), 600, 1200, (change,), estimators=ESTIMATOR)
    assert not differing(record)
    assert differing(replace(record, changes=())) == {"mekf"}


def test_a_motion_that_was_changed_in_flight_begins_anew() -> None:
    """As in its node, which integrates it from zero."""
    change = Change(stamp_of(100, 100.0), REFERENCE, "period_constant", [10.0, 20.0, 30.0])
    record = changed_in_flight(scenario({}), 100, 300, (change,), references=REFERENCE)
    assert not differing(record)
    assert differing(replace(record, changes=())) == {"paper"}


@pytest.mark.parametrize("change", [1e-3, -1e-3])
def test_another_number_is_found_where_it_is(change: float) -> None:
    record = simulate(scenario({}), 2.0)
    torque = record["torque_command"].copy()
    torque[77, 1] += change
    law = replay(with_columns(record, torque_command=torque)).found[0]
    assert law.largest == pytest.approx(1e-3)
    assert (law.column, law.at, law.unit) == ("torque_command", 0.77, "N·m")


def test_what_was_changed_in_flight_is_applied_at_its_stamp() -> None:
    """The motion takes a change over at the next instant, law and actuator at their own."""
    stamp = stamp_of(100, 100.0)
    changes = (
        Change(stamp_of(99, 100.0), PLANT, "inertia", [3.0, 0, 0, 0, 2.5, 0, 0, 0, 2.0]),
        Change(stamp, CONTROLLER, "k", 2.0),
        Change(stamp, PLANT, "max_torque", 0.01),
    )
    parts = {"controllers": CONTROLLER, "actuators": PLANT, "plants": PLANT}
    record = changed_in_flight(scenario(NOISY), 100, 300, changes, **parts)
    assert not differing(record)
    assert differing(replace(record, changes=())) == {"ppc", "rigid_body", "ideal"}


def test_a_law_that_was_disabled_in_flight_gives_zero_from_then_on() -> None:
    record = simulate(scenario({}), 2.0)
    torque = record["torque_command"].copy()
    torque[100:] = 0.0
    disabled = Change(stamp_of(100, 100.0), CONTROLLER, ENABLED, False)
    law = replay(replace(with_columns(record, torque_command=torque), changes=(disabled,))).law
    assert law is not None
    assert (law.largest, law.steps) == (0.0, 201)


def test_a_law_begins_anew_where_stamps_leap_as_its_node_does() -> None:
    record = simulate(scenario({}), 2.0)
    twice = {name: np.concatenate([rows, rows]) for name, rows in record.columns.items()}
    for later, begins in ((8.0, False), (32.0, True)):
        stamps = np.concatenate([record.stamps_ns, record.stamps_ns + nanoseconds(later)])
        law = replay(replace(record, stamps_ns=stamps, columns=twice)).law
        assert law is not None
        assert (law.largest < 1e-12) == begins


def test_a_replay_of_a_record_that_begins_late_says_why_it_differs(
    tmp_path: Path, ask: Ask
) -> None:
    run = simulate(scenario({}), 3.0)
    write_run(part_of(run, slice(100, None)), tmp_path / "bag")
    told = ask("replay", tmp_path / "bag", code=1)
    assert "rigid_body: 201 steps replayed, 0 skipped" in told.out
    assert "warning: the record begins at 1 s: earlier inputs, and the states" in told.err
    rig = {node: values for node, values in run.parameters.items() if node != PLANT}
    for begin, code in ((0, 0), (100, 1)):  # with whom nobody knows where time begins
        cut = part_of(replace(run, parameters=rig), slice(begin, None))
        write_run(cut, tmp_path / f"rig{begin}")
        reason = "warning: the record may begin after the run"
        assert (reason in ask("replay", tmp_path / f"rig{begin}", code=code).err) == bool(code)


def test_a_node_that_was_started_again_with_another_component_is_replayed_until_then() -> None:
    """The new one's parameters went to the old one, whose torque then differed."""
    record, half = simulate(load(configs("paper")), 2.0), stamp_of(100, 100.0)
    other = np.where(record.stamps_ns[:, None] < half, record["torque_command"], 0.01)
    change = Change(half, CONTROLLER, "controller", "quaternion_feedback")
    found = replay(replace(with_columns(record, torque_command=other), changes=(change,)))
    assert found.law is not None
    assert (found.law.component, found.law.steps, found.law.largest) == ("ppc", 100, 0.0)
    told = "quaternion_feedback: ppc_controller was started again with it at 1 s"
    assert told in found.left_out


def test_a_law_that_nobody_knows_is_named() -> None:
    record = replace(simulate(scenario({}), 0.1), controller="theirs")
    found = replay(record)
    assert found.law is None
    assert [each.component for each in found.found] == ["rigid_body", "direct", "ideal", "paper"]
    assert all(each.largest == 0.0 for each in found.found)
    assert found.missing == ("controller = theirs",)
    with pytest.raises(ConfigurationError, match="the parameters of its nodes, which rosbags-con"):
        replay(replace(record, parameters={}))


def test_the_command_names_a_law_that_is_not_installed_and_replays_the_rest(
    tmp_path: Path, ask: Ask
) -> None:
    record = simulate(scenario({}), 0.1)
    record = with_parameters(record, CONTROLLER, {"controller": "theirs", "theirs.gain": 1.0})
    write_run(replace(record, controller="theirs"), tmp_path / "bag")
    told, said = ask("replay", tmp_path / "bag")
    assert "rigid_body: 11 steps replayed" in told
    assert told.count("not installed here, so left out: controller = theirs\n") == 1
    assert "warning: not installed: controller = theirs; columns that only these give" in said
    assert "not installed here, so left out: theirs.gain" in told
    write_run(without_columns(record, "reference_angular_velocity"), tmp_path / "less")
    assert "not replayed: paper: no messages of " in ask("replay", tmp_path / "less").out
    page = ask("replay", tmp_path / "bag", "--json").json
    assert list(page) == described("replay")
    assert page["largest_difference"] is page["steps"] is None
    assert len(page["components"]) == 4


def test_a_difference_from_a_run_of_another_state_of_the_package_is_told_as_that(
    tmp_path: Path, ask: Ask
) -> None:
    run = simulate(scenario({}), 0.1)
    other = with_columns(run, torque_command=run["torque_command"] + 1e-3)
    for name, each, code in (("same", run, 0), ("other", other, 1)):
        write_run(replace(each, metadata={"ppc_attitude": "0.0.1"}), tmp_path / name)
        told = "warning: the run was made by another ppc_attitude (ppc_attitude 0.0.1, here "
        assert (told in ask("replay", tmp_path / name, code=code).err) == bool(code)


def test_a_law_that_gives_no_number_differs(
    tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that was changed since, or that needs what the bag lacks."""
    write_run(simulate(scenario({}), 0.1), tmp_path / "bag")
    law = CONTROLLERS.components["ppc"]
    broken = law.extended("ppc", step=_gives_nan)
    monkeypatch.setitem(CONTROLLERS.components, "ppc", broken)
    told = ask("replay", tmp_path / "bag", code=1).out
    assert "largest difference of torque_command inf N·m at t = 0.000 s" in told
    page = ask("replay", tmp_path / "bag", "--json", code=1).json
    assert page["largest_difference"] is page["components"][0]["largest"] is None


def test_what_is_installed_is_replayed_beside_what_is_not() -> None:
    record = simulate(scenario({}), 0.5)
    theirs = with_parameters(record, PLANT, {"plant": "theirs", "theirs.spin": 1.0})
    found = replay(with_parameters(theirs, CONTROLLER, {"their_law.gain": 3.0}))
    names = [each.component for each in found.found]
    assert names == ["ppc", "direct", "ideal", "paper"]
    assert all(each.largest == 0.0 for each in found.found)
    assert set(found.missing) == {"plant = theirs", "theirs.spin", "their_law.gain"}
