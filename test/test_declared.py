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

"""What the nodes of a run promise to send at each instant, by what is known of them."""

import json

from synthetic import SAMPLED

from ppc_attitude.command_line.parameter_file import run_info
from ppc_attitude.contract import declared
from ppc_attitude.contract.declared import ATTITUDE_ERROR, BY_COLUMN, BY_NAME, promised
from ppc_attitude.contract.topics import (
    CONTROLLER,
    DISTURBANCE,
    ESTIMATOR,
    INJECTOR,
    PLANT,
    REFERENCE,
    TORQUE_COMMAND,
    TRUE_ATTITUDE,
)


def names(parameters: dict[str, dict[str, str]]) -> set[str]:
    return {topic.name for topic in promised(parameters)}


def test_who_took_part_promises_what_it_sends() -> None:
    everyone = {name: {} for name in (PLANT, REFERENCE, INJECTOR)}
    ours = {**everyone, CONTROLLER: {"controller": "ppc"}}
    assert names(ours) == {topic.name for topic in SAMPLED}
    another = {**ours, CONTROLLER: {"controller": "log_barrier"}}
    assert BY_COLUMN["auxiliary_state"].name not in names(another)
    assert names(everyone) == {topic.name for topic in SAMPLED if topic.source != CONTROLLER}
    law = names({CONTROLLER: ours[CONTROLLER]})
    assert law == {topic.name for topic in SAMPLED if topic.source == CONTROLLER}
    assert DISTURBANCE.name not in names({PLANT: {}, CONTROLLER: ours[CONTROLLER]})
    assert names({}) == set()


def test_a_recorder_is_told_what_comes_at_each_instant_and_what_does_not() -> None:
    chosen = {
        PLANT: {"sensors": True},
        ESTIMATOR: {"estimator": "mekf"},
        CONTROLLER: {"controller": "log_barrier"},
    }
    told = run_info({f"/craft/{name}": values for name, values in chosen.items()})
    samples = json.loads(told)["samples"]
    sent = {BY_NAME[name] for names in samples.values() for name in names}
    assert {ATTITUDE_ERROR, TORQUE_COMMAND, TRUE_ATTITUDE} <= sent
    assert BY_COLUMN["auxiliary_state"] not in sent
    assert not [topic for topic in sent if topic.late]
    assert {topic.source for topic in declared.SAMPLED if topic.late} == {PLANT, ESTIMATOR}


def test_a_recorder_is_told_what_a_node_of_the_user_s_has_to_send() -> None:
    """Its name is unknown, so the recorder did not listen to it, and the plant waited for that."""
    told = run_info({f"/craft/{PLANT}": {"actuator": "wheel_motors"}})
    samples = json.loads(told)["samples"][f"/craft/{PLANT}"]
    assert BY_COLUMN["wheel_torque_command"].name in samples
    assert not {TORQUE_COMMAND.name, DISTURBANCE.name} & set(samples)
