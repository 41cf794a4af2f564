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

"""A run must not meet another: a domain is chosen that nobody on this host uses."""

import socket

import pytest
import rclpy
from rclpy.node import Node

from ppc_attitude.command_line.stack import private_environment
from ppc_attitude.nodes.discovery import DOMAINS, choose_domain, ports, unused_domains


@pytest.mark.parametrize("place", [0, 10], ids=["multicast", "unicast alone"])
def test_a_domain_with_a_participant_is_not_chosen(place: int, ros_domain: int) -> None:
    taken = ros_domain  # nobody else takes it, or leaves it
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("0.0.0.0", ports(taken)[place]))
        assert taken not in unused_domains()
        assert all(choose_domain() != taken for _ in range(500))
    assert taken in unused_domains()


@pytest.mark.ros
@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_the_domain_of_a_node_is_not_chosen(
    discovery: str, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", discovery)
    assert ros_domain in unused_domains()
    rclpy.init()
    try:
        node = Node("somebody")
        assert ros_domain not in unused_domains()
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert ros_domain in unused_domains()


def test_ports_of_dds_for_the_first_and_the_last_domain() -> None:
    assert ports(0) == range(7400, 7650)  # DDS-RTPS: PB + DG * domain
    assert ports(DOMAINS[-1])[-1] < 32768  # from there on Linux hands out ephemeral ports


def test_a_domain_of_the_user_is_kept(ros_domain: int) -> None:
    assert private_environment()["ROS_DOMAIN_ID"] == str(ros_domain)
