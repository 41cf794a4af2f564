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

"""What is no part of its kind, or cannot be beside the others, is left out and told."""

from pathlib import Path

from craft_helpers import CONFIG
from outside_helpers import name_points, runs

# Entry points that lead to no part of their kind, and what is told of them.
NONE = {
    "broken = outside_parts:NOWHERE": "of ppc_attitude.controllers cannot be loaded",
    "script = leaving:LAW": "of ppc_attitude.controllers cannot be loaded: SystemExit(5)",
    "skipped = skipping:LAW": "ppc_attitude.controllers cannot be loaded: BaseException('no GPU')",
    "wrong = outside_parts:RING": "is left out: it is a Parameter, not a Component",
}
MISFITS = {
    "controllers": {
        "other_column": "left out: its column attitude has form = 'vector'; allowed: 'quaternion'",
        "other_topic": "left out: its column mine has topic = 'torque_command'",
        "clock": "left out: its column mine has topic = 'clock'",
        "illegal": "topic = 'bad topic!'; allowed",
        "absolute": "topic = '/mine'; allowed",
        "boundless": "left out: its column mine has bounds = 'attitude_eror'; allowed:",
        "of_itself": "left out: its column mine has bounds = 'mine'; allowed: another column",
        "of_unit": "bounds = 'unsaturated_torque'; allowed: another column, with unit = '1'",
        "of_width": "bounds = 'torque_use'; allowed: another column, with unit = '1' and at least",
        "of_another": "column attitude_envelope has bounds = 'attitude'; allowed: another column",
        "of_two": "column mine has bounds = 'attitude_error'; allowed: another column",
        "of_objects": "component share: state = [('z', 'O')]; allowed: a record of numbers",
        "of_money": "unit = '$', meaning = 'x'; allowed: texts, not empty, without $",
        "of_no_unit": "frame = 'body', unit = '', meaning = 'x'; allowed: texts, not empty,",
        "of_no_frame": "frame = '', unit = '1', meaning = 'x'; allowed: texts, not empty,",
        "ours": "left out: the name ppc is taken by ppc_attitude itself",
        "again": "name other_column is taken by entry point other_column = misfits:other_column of",
        "nameless": "column '' with topic",
        "numbered": "left out: its name = 5; allowed: a text",
        "unlabelled": "left out: its name = ''; allowed: a text",
        "twice": "component share: two columns are named torque_use",
        "of_node": "left out: ppc_controller has another parameter wait_for_recorder than of_node",
        "of_ros": "left out: ppc_controller has another parameter use_sim_time than of_ros",
        "selector": "has another parameter controller than selector; allowed: one that is declared",
        "of_front": "left out: ppc_controller has another parameter max_torque than of_front",
        "in_degrees": "left out: its column angular_velocity has unit = 'deg/s'; allowed: 'rad/s'",
        "two": "left out: ppc_controller has another parameter z than two",
        "plain": "left out: component plain: step = <function",
        "no_default": "left out: z = None; allowed: finite",
        "beyond": "left out: z = 3; allowed: an integer, ≥ -9223372036854775807, ≤ 1",
        "vast": "left out: z = 1180591620717411303424; allowed: an integer, ≥ -92",
        "long_turn": "z: length = 0; allowed for quaternions: 4, -4",
        "unnamed_number": "parameter '' with description = 'x', unit = ''; allowed: a name of",
        "undescribed": "parameter 'z' with description = None, unit = ''; allowed: a name of",
        "far": "allowed: a name of letters, digits and _, and a relative topic",
        "cubic": "column mine: form = 'cube'; allowed: ",
        "of_four": "column mine: width = 4; allowed for a vector: ",
        "of_no_part": "column mine: part = ''; allowed: a name of letters, digits and _ with a ",
        "of_part": "column torque_use: part = 'wheel'; allowed: a name of letters, digits and _ ",
        "giver": "",
    },
    "plants": {
        "first": "",
        "reader": "left out: its column asked has unit = 'm'; allowed: '1'",
    },
    "sensors": {
        "second": "left out: its column pair has unit = 'm'; allowed: '1'",
        "of_kind": "left out: spacecraft_plant has another parameter max_torque than of_kind",
    },
    "actuators": dict.fromkeys(("no_limit", "no_quiet"), "it has no parameter nowhere"),
    "disturbances": {"pulse": "left out: allowed groups: ppc_attitude.actuators, "},
    "controller": {"singular": "left out: allowed groups: ppc_attitude.actuators, "},
}


def test_what_is_no_part_or_cannot_be_beside_the_others_is_left_out_and_breaks_nothing(
    tmp_path: Path,
) -> None:
    points = {
        kind: [f"{name} = misfits:{name}" for name in misfits] for kind, misfits in MISFITS.items()
    }
    points["controllers"] += NONE
    points["plants"].append("share = outside_parts:LAW")
    run = runs(tmp_path)
    name_points(tmp_path, **{kind: "\n".join(lines) for kind, lines in points.items()})
    (tmp_path / "installed/leaving.py").write_text("raise SystemExit(5)\n")
    (tmp_path / "installed/skipping.py").write_text("raise BaseException('no GPU')\n")
    code = (
        "import sys\nfrom ppc_attitude.command_line.main import main\n"
        "from ppc_attitude.science.kinds import all_components\n"
        "code = main(sys.argv[1:])\nprint(*(each.name for each in all_components()))\n"
        "sys.exit(code)"
    )
    done = run("check", "--config", str(CONFIG / "paper.yaml"), script=code)
    kept = done.stdout.splitlines()[-1].split()
    warned = done.stderr.splitlines()
    assert all("UserWarning: entry point " in line for line in warned), done.stderr
    for kind, misfits in MISFITS.items():
        for name, problem in misfits.items():
            assert (name in kept) == (not problem), name
            of_it = f"Warning: entry point {name} = misfits:{name} of ppc_attitude.{kind}"
            told = [line for line in warned if of_it in line]
            assert [problem in line for line in told] == [True] * bool(problem), told
    for point, problem in {**NONE, "share =": "share lacks the outputs truth_attitude"}.items():
        assert [problem in line for line in warned if point in line] == [True], point
    assert "share" not in kept
    assert "ppc" in kept
