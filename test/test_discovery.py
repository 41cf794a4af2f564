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

"""Who finds a node: by UDP, on this host where that is asked for, in a domain that nobody uses."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import rclpy
from process_helpers import COMMAND, Process, Run, StartProcess, ran
from rclpy.node import Node

from ppc_attitude.command_line.main import main
from ppc_attitude.command_line.stack import private_environment
from ppc_attitude.contract.topics import RECORDER
from ppc_attitude.nodes.discovery import (
    ANYWHERE,
    DOMAINS,
    MIDDLEWARE,
    THIS_HOST,
    choose_domain,
    reach,
    tune_transport,
    unused_domains,
)
from ppc_attitude.nodes.running import run_node

long = pytest.mark.long
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
RANGE, DOMAIN = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DOMAIN_ID"
PEERS, ONLY, TRANSPORTS = "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY", "FASTDDS_BUILTIN_TRANSPORTS"
PEERED = {RANGE: "LOCALHOST", PEERS: "127.0.0.1"}
ALONE = {"SKIP_DEFAULT_XML_FILE": "1"}
NAMESPACE = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


def part(profile: Path, name: str) -> list[tuple[str, str]]:
    found = ElementTree.parse(profile).getroot().iter(f"{NAMESPACE}{name}")
    return [(each.tag, (each.text or "").strip()) for each in next(found).iter()]


@pytest.mark.parametrize("name", ["data_writer", "builtin"])
def test_both_profiles_write_and_announce_alike(name: str) -> None:
    assert part(ANYWHERE, name) == part(THIS_HOST, name)
    assert len(part(ANYWHERE, name)) > 4


CLOSED = {RANGE: "SYSTEM_DEFAULT", PROFILE: str(THIS_HOST), **ALONE}
OPEN = {TRANSPORTS: "UDPv4", PROFILE: str(ANYWHERE), **ALONE}


@pytest.mark.parametrize(
    ("told", "tuned"),
    [
        pytest.param({RANGE: "LOCALHOST"}, CLOSED, id="loopback alone"),
        pytest.param({RANGE: "LOCALHOST", PEERS: ";;"}, {**CLOSED, PEERS: ";;"}, id="no peers"),
        pytest.param({RANGE: "SUBNET", ONLY: "1"}, CLOSED, id="the older word for it"),
        *(({**wider}, {**OPEN, **wider}) for wider in ({}, {RANGE: ""}, {RANGE: "SUBNET"})),
        pytest.param({ONLY: "0"}, {**OPEN, ONLY: "0"}, id="the older word for elsewhere"),
        pytest.param({**PEERED}, {**OPEN, **PEERED}, id="peers elsewhere stay in force"),
        *(
            pytest.param({RANGE: "LOCALHOST", name: "mine"}, {RANGE: "LOCALHOST", name: "mine"})
            for name in (PROFILE, "FASTDDS_DEFAULT_PROFILES_FILE", TRANSPORTS)
        ),
    ],
    ids=str,
)
def test_the_transport_is_tuned_to_the_range_that_is_asked_for(
    told: dict[str, str], tuned: dict[str, str]
) -> None:
    """Settings of the user's own are kept."""
    tune_transport(told)
    assert told == tuned


def test_another_middleware_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = "rclpy.utilities.get_rmw_implementation_identifier"
    monkeypatch.setattr(asked, lambda: "rmw_cyclonedds_cpp")
    environment = {RANGE: "LOCALHOST"}
    tune_transport(environment)
    assert environment == {RANGE: "LOCALHOST"}


SOCKETS = """
import os
from pathlib import Path
import rclpy
from ppc_attitude.nodes.discovery import tune_transport
tune_transport()
rclpy.init()
node = rclpy.create_node("looked_at")
mine = {os.readlink(fd) for fd in map(str, Path("/proc/self/fd").iterdir()) if os.path.exists(fd)}
for row in Path("/proc/net/udp").read_text().splitlines()[1:]:
    if f"socket:[{row.split()[9]}]" in mine:
        print(".".join(str(byte) for byte in bytes.fromhex(row.split()[1][:8])[::-1]))
node.destroy_node()
rclpy.shutdown()
"""


LOOPBACK = {"127.0.0.1", "239.255.0.1"}  # the group that loopback alone has joined


@pytest.mark.ros
@pytest.mark.skipif(sys.byteorder != "little", reason="/proc/net/udp is in the host's byte order")
@pytest.mark.parametrize(
    ("told", "closed"),
    [
        ({RANGE: "LOCALHOST"}, True),
        pytest.param({RANGE: "SUBNET", ONLY: "1"}, True, marks=long),
        pytest.param({RANGE: "LOCALHOST", ONLY: "0"}, True, marks=long),
        ({RANGE: "SUBNET"}, False),
        pytest.param({RANGE: "LOCALHOST", TRANSPORTS: "UDPv4"}, False, marks=long),
    ],
    ids=str,
)
def test_what_is_said_is_what_is_bound(
    told: dict[str, str], closed: bool, tmp_path: Path, start_process: StartProcess
) -> None:
    """A profile in the current folder changes nothing."""
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_bytes(ANYWHERE.read_bytes())
    looked_at = Process(
        start_process,
        tmp_path,
        "looked_at",
        [sys.executable, "-c", SOCKETS],
        env={**os.environ, **told},
        cwd=tmp_path,
    )
    assert looked_at.ends() == 0, looked_at.err
    addresses = set(looked_at.out.split())
    assert addresses
    assert (addresses <= LOOPBACK) == closed
    assert (reach(told) == "localhost") == closed


@pytest.mark.parametrize(
    ("environment", "named"),
    [
        ({RANGE: "localhost"}, "ROS_AUTOMATIC_DISCOVERY_RANGE = 'localhost'; allowed: LOCALHOST, "),
        ({RANGE: "OFF"}, "OFF: no node would find another; allowed: LOCALHOST, SUBNET, SYSTEM_DEF"),
        ({DOMAIN: "-1"}, "ROS_DOMAIN_ID = '-1'; allowed: 0 to 232"),
        ({DOMAIN: "233"}, "ROS_DOMAIN_ID = '233'; allowed: 0 to 232"),
        ({DOMAIN: "7x"}, "ROS_DOMAIN_ID = '7x'"),
        ({DOMAIN: "010"}, "ROS_DOMAIN_ID = '010'; allowed: 0 to 232, without leading zeros"),
        ({DOMAIN: "9" * 5000}, "ROS_DOMAIN_ID = '9999"),
        ({DOMAIN: "²"}, "ROS_DOMAIN_ID = '²'"),
        ({PEERS: "127.0.0.1;no.such.invalid"}, "ROS_STATIC_PEERS: 'no.such.invalid'"),
        ({PEERS: "a..b"}, "ROS_STATIC_PEERS: 'a..b'"),
    ],
    ids=str,
)
def test_a_wrong_environment_is_refused_by_every_command_and_node(
    environment: dict[str, str],
    named: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    for command in (["run"], ["latency"], ["latency", "--live"], ["watch"], ["inject", *"123"]):
        assert main(command) == 2
        told = capfd.readouterr().err
        assert named in told
        assert told.count("\n") == 1
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert run_node(lambda: pytest.fail("made"), ["node"]) == 2
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert named in capfd.readouterr().err


@pytest.mark.ros
@pytest.mark.parametrize(
    ("environment", "named"),
    [
        ({"ROS_LOG_DIR": "/dev/null"}, "Failed to create log directory '/dev/null'"),
        pytest.param(
            {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"},
            "initialize rcl",
            marks=long,
        ),
    ],
    ids=["logs", "keys"],
)
def test_an_environment_that_ros_refuses_is_told_by_who_visits(
    environment: dict[str, str], named: str, tmp_path: Path, start_process: StartProcess
) -> None:
    env = os.environ | environment
    visit = Process(start_process, tmp_path, "watch", [*COMMAND, "watch", "--once"], env=env)
    assert visit.ends() == 2, visit.err
    *_, reason = visit.err.splitlines()
    assert reason.startswith("error: ")
    assert named in reason
    assert "Traceback" not in visit.err


@pytest.mark.ros
def test_a_run_names_a_middleware_that_is_not_installed(
    tmp_path: Path, start_process: StartProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(MIDDLEWARE, "rmw_none")
    run = Run(start_process, tmp_path / "bag")
    assert run.ends() == 2
    assert "RMW_IMPLEMENTATION = 'rmw_none'; allowed: an installed" in run.err.splitlines()[-1]
    assert not run.bag.exists()


def test_an_empty_setting_leaves_the_sockets_to_us(monkeypatch: pytest.MonkeyPatch) -> None:
    empty = dict.fromkeys((MIDDLEWARE, PROFILE, TRANSPORTS), "")
    assert reach({RANGE: "LOCALHOST", **empty}) == "localhost"
    assert reach({RANGE: "", **empty}) == "subnet"
    assert reach({RANGE: "LOCALHOST", TRANSPORTS: "SHM"}).endswith(f"that {TRANSPORTS} selects")
    assert reach(PEERED) == "localhost and ROS_STATIC_PEERS"
    monkeypatch.setattr("ppc_attitude.nodes.discovery._has_way", lambda address: False)
    tune_transport({TRANSPORTS: "SHM"})  # by this nodes may find each other all the same


@pytest.mark.parametrize("unset", [{}, {RANGE: "", DOMAIN: ""}], ids=["none", "empty"])
def test_a_run_is_on_this_host_alone_and_in_a_domain_of_its_own(
    unset: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (RANGE, DOMAIN):
        monkeypatch.delenv(name)
    for name, value in unset.items():
        monkeypatch.setenv(name, value)
    made = private_environment()
    assert made[RANGE] == "LOCALHOST"
    assert int(made[DOMAIN]) in DOMAINS


def test_range_and_domain_of_the_user_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RANGE, "SYSTEM_DEFAULT")
    monkeypatch.setenv(DOMAIN, "232")
    made = private_environment()
    assert (made[RANGE], made[DOMAIN]) == ("SYSTEM_DEFAULT", "232")


def test_where_no_sockets_are_told_any_domain_may_be_chosen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As of UDP by IPv6 where Linux has none."""
    monkeypatch.setattr("ppc_attitude.nodes.discovery._SOCKETS", (Path("/none"),))
    assert unused_domains() == list(DOMAINS)


ALONE_IN_THE_NET = ["unshare", "--net", "--map-root-user"]


@pytest.mark.skipif(
    shutil.which(ALONE_IN_THE_NET[0]) is None
    or subprocess.run([*ALONE_IN_THE_NET, "true"], capture_output=True, check=False).returncode,
    reason="no network without an interface can be made here",
)
@pytest.mark.parametrize("discovery", ["SUBNET", pytest.param("LOCALHOST", marks=long)])
def test_a_host_whose_interfaces_are_all_down_is_told_at_once(discovery: str) -> None:
    command = [*ALONE_IN_THE_NET, sys.executable, "-m", f"ppc_attitude.nodes.{RECORDER}"]
    told = ran(command, 2, env={RANGE: discovery}).stderr
    assert told.startswith("error: the network interface lo (loopback) is down"), told


@pytest.mark.ros
@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_the_domain_of_a_node_is_not_chosen(
    discovery: str, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(RANGE, discovery)
    assert ros_domain in unused_domains()
    rclpy.init()
    try:
        node = Node("somebody")
        assert ros_domain not in unused_domains()
        assert all(choose_domain() != ros_domain for _ in range(500))
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert ros_domain in unused_domains()
