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

"""How the middleware is set up: by UDP, on this host where that is asked for, and by the user."""

import os
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from process_helpers import Process, StartProcess

from ppc_attitude.nodes.transport import ANYWHERE, THIS_HOST, tune_transport

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
NAMESPACE = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


def writer(profile: Path) -> list[tuple[str, str]]:
    found = ElementTree.parse(profile).getroot().iter(f"{NAMESPACE}data_writer")
    return [(each.tag, (each.text or "").strip()) for each in next(found).iter()]


def test_both_profiles_write_alike() -> None:
    assert writer(ANYWHERE) == writer(THIS_HOST)
    assert len(writer(ANYWHERE)) > 5


def test_localhost_means_loopback_alone() -> None:
    environment = {RANGE: "LOCALHOST"}
    tune_transport(environment)
    assert environment == {RANGE: "SYSTEM_DEFAULT", PROFILE: str(THIS_HOST)}


@pytest.mark.parametrize("told", [{}, {RANGE: "SUBNET"}, {RANGE: "OFF"}])
def test_a_wider_range_stays_as_it_is(told: dict[str, str]) -> None:
    environment = dict(told)
    tune_transport(environment)
    expected = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", PROFILE: str(ANYWHERE)}
    assert environment == {**told, **expected}


@pytest.mark.parametrize("name", ["ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS"])
def test_what_ros_adds_to_the_range_stays_in_force(name: str) -> None:
    environment = {RANGE: "LOCALHOST", name: "1"}
    tune_transport(environment)
    assert environment[RANGE] == "LOCALHOST"
    assert environment[PROFILE] == str(ANYWHERE)


@pytest.mark.parametrize(
    "name", [PROFILE, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS"]
)
def test_the_users_own_settings_are_kept(name: str) -> None:
    environment = {RANGE: "LOCALHOST", name: "mine"}
    tune_transport(environment)
    assert environment == {RANGE: "LOCALHOST", name: "mine"}


def test_another_middleware_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "ppc_attitude.nodes.transport.get_rmw_implementation_identifier",
        lambda: "rmw_cyclonedds_cpp",
    )
    environment = {RANGE: "LOCALHOST"}
    tune_transport(environment)
    assert environment == {RANGE: "LOCALHOST"}


SOCKETS = """
import os
from pathlib import Path
import rclpy
from ppc_attitude.nodes.transport import tune_transport
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


@pytest.mark.ros
@pytest.mark.skipif(sys.byteorder != "little", reason="/proc/net/udp is in the host's byte order")
def test_a_node_of_this_host_opens_no_door_to_others(
    tmp_path: Path, start_process: StartProcess
) -> None:
    """Every socket is bound to loopback, or to the group that loopback alone has joined."""
    command = [sys.executable, "-c", SOCKETS]
    looked_at = Process(start_process, tmp_path, "looked_at", command, env=dict(os.environ))
    assert looked_at.ends() == 0, looked_at.err
    addresses = looked_at.out.split()
    assert addresses
    assert set(addresses) <= {"127.0.0.1", "239.255.0.1"}
