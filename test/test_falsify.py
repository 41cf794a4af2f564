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

"""The adversary: it keeps its bounds, goes on where it was, and finds what is broken."""

import math
import signal
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import configs
from docs_helpers import described
from process_helpers import PAPER, room_for
from scipy.spatial.transform import Rotation

from ppc_attitude.campaign.declaration import campaign
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, INJECTOR, PLANT, REFERENCE
from ppc_attitude.falsify.goals import Goal, goal_of
from ppc_attitude.falsify.search import HISTORY, Found, Search, evaluated
from ppc_attitude.falsify.space import Space
from ppc_attitude.processes.exits import BROKEN, RunError
from ppc_attitude.science.actuators import ideal
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guarantee.surroundings import inertia_error
from ppc_attitude.science.kinds import ACTUATORS, ENVIRONMENTS, PLANTS
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load


def space_of(duration: float = 20.0, **changes: Any) -> Space:
    base = load(configs("paper", "guaranteed"), {PLANT: {"duration": duration}})
    given = {
        "rate": math.radians(1.0),
        "disturbance": 4.374e-3,
        "pieces": 4,
        "e_S": 0.1,
        "eta": 0.8,
        "begin": 500.0,
        "late": True,
    }
    return Space(base, **(given | changes))


def search(space: Space, folder: Path, runs: int, goal: Goal | None = None) -> Found:
    adversary = Search(space, goal or Goal("terminal"), folder, seed=1)
    with ThreadPoolExecutor(2) as threads:
        *_, last = adversary.run(runs, 60.0, threads, Event())
    return last


def test_every_choice_keeps_its_bounds() -> None:
    space = space_of()
    random = np.random.default_rng(2)
    known = np.array(space.base.parameters[PLANT]["inertia"])
    late = set()
    for width in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0):
        choice = space.choice(x := width * random.normal(size=space.size))
        plant, injector = choice[PLANT], choice[INJECTOR]
        assert plant["initial_attitude"] == pytest.approx(x[:4] / np.linalg.norm(x[:4]))
        assert np.linalg.norm(plant["initial_angular_velocity"]) <= space.rate * (1 + 1e-12)
        torques, error = injector["pulse_torques"], inertia_error(known, np.array(plant["inertia"]))
        assert np.abs(torques).max() <= space.disturbance
        assert error <= space.e_S * (1 + 1e-9)
        if width > 9.0:
            assert (min(torques), max(torques)) == (-space.disturbance, space.disturbance)
            assert error == pytest.approx(space.e_S)
        assert 0.04 <= plant["max_torque"] <= 0.05
        assert 0.0 <= choice[REFERENCE]["begin"] <= 500.0
        late.add(plant["late_command"])
    assert late == {True, False}


@pytest.mark.parametrize(("largest", "least"), [(2.0, 0.0), (1.9, 1e-3)])
def test_what_an_error_makes_of_a_plate_is_a_body(largest: float, least: float) -> None:
    """No plane body has a larger moment about its normal; a thicker one has an error at least."""
    known = [1.0, 0, 0, 0, 1.0, 0, 0, 0, largest]
    space = replace(space_of(), base=space_of().base.with_values(PLANT, inertia=known))
    random, found = np.random.default_rng(2), set()
    for _ in range(20):
        inertia = space.choice(random.normal(size=space.size))[PLANT]["inertia"]
        x, y, z = np.linalg.eigvalsh(np.reshape(inertia, (3, 3)))
        assert x + y >= z * (1 - 1e-9)
        assert inertia_error(np.array(known), np.array(inertia)) >= least
        found.add(tuple(inertia))
    assert len(found) > 1


def test_an_interrupted_search_goes_on_to_the_same_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    space = space_of(duration=2.0)
    history = tmp_path / "new" / "whole" / HISTORY
    whole = search(space, history.parent, 40)
    file = tmp_path / "cut" / HISTORY
    file.parent.mkdir()
    file.write_text(history.read_text()[:30])  # cut in its first line
    search(space, file.parent, 20)
    file.write_text(file.read_text() + "[0.1, 0.2")  # a line that an interruption cut
    monkeypatch.delattr(Path, "write_text")  # the history is empty while it is written anew
    resumed = search(space, tmp_path / "cut", 40)
    assert resumed.runs == whole.runs
    assert resumed.value == whole.value
    assert np.array_equal(resumed.x, whole.x)
    assert file.read_text() == history.read_text()


def test_a_history_for_which_there_is_no_room_is_named_and_the_search_goes_on(
    tmp_path: Path,
) -> None:
    space = space_of(duration=2.0)
    with room_for(100), pytest.raises(OSError, match=f"File too large: '{tmp_path / HISTORY}'"):
        search(space, tmp_path, 20)
    assert search(space, tmp_path, 20).runs >= 20


def test_a_folder_of_another_search_is_refused(tmp_path: Path) -> None:
    search(space_of(duration=2.0), tmp_path, 20)
    with pytest.raises(ConfigurationError, match="belongs to another search"):
        search(space_of(duration=3.0), tmp_path, 20)
    history = (tmp_path / HISTORY).read_text()
    for answers, told in (
        ("[]", r"has a generation of 0 runs; allowed: \d+"),
        ("{", "is no history"),
    ):
        (tmp_path / HISTORY).write_text(f"{history}{answers}\n")
        with pytest.raises(ConfigurationError, match=f"{HISTORY} {told}"):
            search(space_of(duration=2.0), tmp_path, 99)


def test_a_search_comes_near_the_top(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ppc_attitude.falsify.search.evaluated", lambda *x: 1.0 - sum(x[2] ** 2))
    found = search(space_of(pieces=0), tmp_path, 400)
    assert 0.9 < found.value == 1.0 - sum(found.x**2)


def test_what_nothing_selected_has_is_no_part_of_a_search() -> None:
    """Installing a package whose parts are not used ends no search."""
    told = space_of(duration=2.0).to_json()["parameters"][PLANT]
    assert {"duration", "max_torque", "plant"} <= told.keys()
    assert not any(name.startswith(("wheels.", "thrusters.", "gyro.")) for name in told)


def test_answers_of_a_law_that_was_changed_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The largest of the old answers was told of a case that does not give it."""
    space = space_of(duration=2.0)
    search(space, tmp_path, 20)
    monkeypatch.setattr("ppc_attitude.falsify.search.evaluated", lambda *_: 0.125)
    with pytest.raises(ConfigurationError, match=r"its worst case gave .* and gives 0\.125 now"):
        search(space, tmp_path, 20)


def test_two_searches_at_once_in_a_folder_are_refused(tmp_path: Path) -> None:
    space = space_of(duration=2.0)
    one, other = (Search(space, Goal("terminal"), tmp_path, seed=1) for _ in range(2))
    with ThreadPoolExecutor(2) as threads, closing(one.run(99, 9.0, threads, Event())) as running:
        next(running)
        with pytest.raises(ConfigurationError, match=f"another search uses {tmp_path}"):
            next(other.run(99, 9.0, threads, Event()))


def test_a_search_that_waits_for_workers_that_have_gone_ends(tmp_path: Path) -> None:
    adversary = Search(space_of(), Goal("rate"), tmp_path, seed=1)
    idle, check = Mock(submit=lambda *_: Future[float]()), Mock(side_effect=RunError("no worker"))
    with pytest.raises(RunError, match="no worker"):
        next(adversary.run(9, 60.0, idle, Event(), check))


def test_an_interrupted_search_says_so_and_what_has_not_settled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    flown, over = [], Event()

    def simulated(*given: Any) -> float:
        flown.append(given)
        if len(flown) == 20:  # in the second generation
            signal.raise_signal(signal.SIGINT)
            over.wait()
        return 5.97

    monkeypatch.setattr("ppc_attitude.falsify.search.evaluated", simulated)
    said = ask("falsify", "--duration=5", "--pieces=3", f"--out={tmp_path}", code=BROKEN)
    over.set()
    assert " runs: not settled at 5 s (error 0.97)\n" in said.out
    assert "error: interrupted after 13 of 1000 runs; the same command" in said.err
    assert "settling: not settled at 5 s" in (tmp_path / "worst.yaml").read_text()


def test_a_search_that_is_asked_to_end_in_its_last_generation_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    def simulated(*_: Any) -> float:
        signal.raise_signal(signal.SIGINT)
        return 0.0

    monkeypatch.setattr("ppc_attitude.falsify.search.evaluated", simulated)
    monkeypatch.setattr("ppc_attitude.falsify.search._GLANCE", 60.0)  # the generation is quicker
    said = ask("falsify", "--duration=5", "--pieces=3", "--runs=1", f"--out={tmp_path}")
    assert "of 13 runs" in said.out


def test_the_worst_case_is_a_configuration_that_gives_the_value(tmp_path: Path, ask: Ask) -> None:
    overlays = [f"--config={path}" for path in configs("paper", "guaranteed")]
    bounds = ["--runs=40", "--pieces=3", f"--out={tmp_path}", "--duration=30", "--goal=terminal"]
    told = ask("falsify", *overlays, *bounds, "--json", code=1).json
    assert list(told) == described("falsify")
    assert told["passes_limit"]  # within 30 s the law does not settle
    assert told["told"] == f"{told['largest']:.6g}"
    metrics = ask("simulate", *overlays, f"--config={told['worst']}", "--json").json["metrics"]
    assert metrics["terminal_error"] == pytest.approx(told["largest"], rel=1e-12)


def test_sudden_disturbances_of_the_scenario_act_too() -> None:
    hit = {"pulse_times": [5.0], "pulse_durations": [0.5], "pulse_torques": [0.0, 0.2, 0.0]}
    space = space_of()
    hit_too = replace(space, base=space.base.overlaid({INJECTOR: hit}))
    choice = np.zeros(space.size)
    choice[3] = 1.0
    calm, sudden = (simulate(each.scenario(choice), 20.0) for each in (space, hit_too))
    more = (sudden["disturbance_torque"] - calm["disturbance_torque"])[:, 1]
    assert set(more) == {0.0, 0.2}
    assert more.sum() * 0.01 == pytest.approx(0.2 * 0.5)


def test_the_disturbance_is_as_large_as_the_configured_environment(
    tmp_path: Path, ask: Ask
) -> None:
    """Else that of the paper acted on every craft: on one of 1 kg a thousand times its actuator."""
    told = ["--duration=5", "--runs=1", "--pieces=1", f"--out={tmp_path}"]
    orbit = [f"--config={path}" for path in configs("paper", "orbit")]
    ask("falsify", *orbit, *told)
    worst = load([*configs("paper", "orbit"), tmp_path / "worst.yaml"]).parameters[INJECTOR]
    orbiting = load(configs("paper", "orbit")).parameters[INJECTOR]
    most = ENVIRONMENTS.components["orbit"].bound(orbiting)
    assert 0.0 < np.abs(worst["pulse_torques"]).max() <= most < 1e-3


def test_the_environment_knows_the_inertia_of_the_worst_case(tmp_path: Path, ask: Ask) -> None:
    """Else the file was refused: the gravity gradient needs the craft's inertia."""
    told = ["--duration=5", "--runs=1", "--pieces=0", "--inertia-error=0.1", f"--out={tmp_path}"]
    orbit = configs("paper", "orbit")
    ask("falsify", *(f"--config={path}" for path in orbit), *told)
    worst = load([*orbit, tmp_path / "worst.yaml"]).parameters
    assert worst[PLANT]["inertia"] == worst[INJECTOR]["inertia"] != worst[CONTROLLER]["inertia"]
    assert "*id" not in (tmp_path / "worst.yaml").read_text()  # ROS reads no aliases


def test_an_option_that_chose_the_law_is_in_the_worst_case(tmp_path: Path, ask: Ask) -> None:
    """Else the file, run with the same configuration, was a run of the paper's law."""
    told = ["--controller=quaternion_feedback", "--duration=5", "--pieces=1", "--disturbance=0.01"]
    told += [f"--config={PAPER}", f"--out={tmp_path}"]
    short = ask("falsify", *told, "--seconds=1e-9", code=2).err
    assert "--seconds 1e-09; allowed: enough for one generation of runs" in short
    ask("falsify", *told, "--runs=1")
    assert load([PAPER, tmp_path / "worst.yaml"]).controller.name == "quaternion_feedback"


def test_error_and_rate_are_the_true_ones() -> None:
    """With sensors the noise of what the law was told had been added: 3°/s seemed broken."""
    base = load(configs("paper", "sensors_cubesat"))
    record = simulate(base, 60.0)
    rates = np.degrees(np.linalg.norm(record["truth_angular_velocity"], axis=1))
    assert Goal("rate").value(record) == rates.max()
    desired, attitude = (
        Rotation.from_quat(record[name]) for name in ("reference_attitude", "truth_attitude")
    )
    error = np.abs((desired.inv() * attitude).as_quat()[:, :3]).max(axis=1)
    assert Goal("settling", accuracy=1.0).value(record) == 0.0  # it always is
    last = error[record.stamps_ns >= record.stamps_ns[-1] - 20 * 10**9].max()
    assert Goal("terminal").value(record) == pytest.approx(last, rel=1e-12)


@pytest.mark.parametrize(
    ("law", "name", "bound"),
    [("guaranteed", "turn", "turn_envelope"), ("any_start", "attitude_error", "attitude_envelope")],
)
def test_an_attitude_error_in_its_bound_is_the_true_one(law: str, name: str, bound: str) -> None:
    """What the law was told had been compared: 0.58 of Φ where the craft was at 0.64."""
    base = load(configs("paper", law, "sensors_cubesat"))
    record = simulate(base, 60.0)
    desired, attitude = (
        Rotation.from_quat(record[each]) for each in ("reference_attitude", "truth_attitude")
    )
    error = desired.inv() * attitude
    sizes = error.magnitude()[:, None] if name == "turn" else np.abs(error.as_quat()[:, :3])
    largest = (sizes / record[bound])[record.t >= 20.0].max()
    value = Goal(name, after=20.0).value(record)
    assert value == pytest.approx(largest, rel=1e-9)


def test_what_no_law_has_before_the_first_fix_passes_no_bound() -> None:
    """Without an attitude the envelope is zero: every start was as bad as one that diverges."""
    late: dict[str, Any] = {node: {"initial_fix": False} for node in (PLANT, ESTIMATOR)}
    base = load(configs("paper", "sensors_smallsat"), late)
    record = simulate(base, 5.0)
    known = record["attitude_envelope"].all(axis=1)
    assert known.any() and not known.all()
    later = Goal("attitude_error", after=float(record.t[known][0]))
    value = Goal("attitude_error").value(record)
    assert value == later.value(record) < math.inf


def test_a_true_turn_goes_the_laws_way_round() -> None:
    base = load(configs("paper", "guaranteed", "sensors_flagship"))
    record = simulate(base, 1.0)
    way = 2.0 * np.pi - record["turn"]
    other = replace(record, columns={**record.columns, "turn": way, "turn_envelope": way})
    assert Goal("turn").value(other) == pytest.approx(1.0, abs=1e-3)


def test_a_law_without_a_guarantee_is_broken() -> None:
    """The paper's law leaves its envelope from a start that its table cannot follow."""
    base = load([PAPER], {PLANT: {"duration": 60.0}})
    space = Space(base, math.radians(1.0), 4.374e-3, 0, 0.0, 1.0)
    goal = goal_of("attitude_error", base, 5e-3, 0.0)
    x = np.zeros(space.size)
    x[0] = 1.0  # half a turn about x, in the inertial frame
    assert evaluated(space, goal, x) > goal.limit


@pytest.mark.parametrize(
    ("chosen", "told"),
    [
        ({"eta": 1e-3}, r"min_torque = 0\.0001 N·m must be smaller than max_torque = 5"),
        ({"rate": 80.0}, r"initial_angular_velocity = .* turns by 0\.8 rad in a step"),
        ({"pieces": 5000}, r"the pulse from 0\.004 to 0\.008 s lies between two"),
    ],
)
def test_what_no_craft_can_fly_is_refused_before_the_search(
    chosen: dict[str, float], told: str
) -> None:
    """A search ended at the first choice that came near its bounds, and told of no worst case."""
    with pytest.raises(ConfigurationError, match=told):
        space_of(**chosen)


@pytest.mark.parametrize(
    ("chosen", "declared", "told"),
    [
        ({}, {"initial_attitude": "so3"}, "plant = bare has no parameter initial_attitude"),
        ({"e_S": 0.1}, {"inertia_error": 0.1}, "inert.*: plant = bare has no parameter inertia"),
        ({"begin": 3.0}, {}, "begin of the reference: mode = goal has no parameter begin"),
        (
            {"eta": 0.5},
            {"actuator_strength": 0.5},
            "strength = 0.5; .* actuator = ideal has no limits",
        ),
    ],
)
def test_what_no_component_has_is_not_varied(
    monkeypatch: pytest.MonkeyPatch,
    chosen: dict[str, float],
    declared: dict[str, Any],
    told: str,
) -> None:
    """Of a plant or an actuator of somebody else's, nothing would come of it."""
    base = load(configs("paper")).with_values(REFERENCE, mode="goal")
    lacking = told.rpartition(" ")[2]
    kept = tuple(each for each in rigid_body.COMPONENT.parameters if each.name != lacking)
    bare = replace(rigid_body.COMPONENT, name="bare", parameters=kept)
    if "bare" in told:
        monkeypatch.setitem(PLANTS.components, "rigid_body", bare)
    monkeypatch.setitem(ACTUATORS.components, "ideal", replace(ideal.COMPONENT, limits=()))
    nothing = {"rate": 0.0, "disturbance": 0.0, "pieces": 0, "e_S": 0.0, "eta": 1.0}
    with pytest.raises(ConfigurationError, match=told):
        Space(base, **(nothing | chosen))
    if declared:
        with pytest.raises(ConfigurationError, match=told):
            campaign(declared, base, 0)


@pytest.mark.parametrize("runs", [40, pytest.param(80, marks=pytest.mark.long)])
def test_no_short_attack_breaks_the_guarantee(runs: int, tmp_path: Path) -> None:
    space = space_of(pieces=10, e_S=0.0, eta=1.0, late=False, duration=40.0)
    for name in ("turn", "momentum_error", "rate"):
        goal = goal_of(name, space.base, 5e-3, 6.0)
        assert search(space, tmp_path / name, runs, goal).value <= goal.limit
