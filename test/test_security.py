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

"""A secured run has keys and enforces them, or it does not run and says why."""

import os
from pathlib import Path

import pytest
from process_helpers import Run, StartProcess

from ppc_attitude.command_line.security import domain_of, secured
from ppc_attitude.science.errors import ConfigurationError

HERE = {"PATH": os.environ["PATH"], "ROS_DOMAIN_ID": "7"}
ROS2 = """#!/bin/sh
echo "$@" >> "$(dirname "$0")/asked"
if [ "$2" = create_keystore ]; then
  mkdir -p "$3/enclaves"
  exec echo "<domains> <id>$ROS_DOMAIN_ID</id> </domains>" > "$3/enclaves/governance.xml"
fi
mkdir -p "$3/enclaves$4"
cd "$3/enclaves$4"
touch identity_ca.cert.pem cert.pem key.pem permissions_ca.cert.pem governance.p7s permissions.p7s
"""


@pytest.fixture
def ros2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for the command that makes keys; gives the file of what it was asked."""
    program = tmp_path / "bin" / "ros2"
    program.parent.mkdir()
    program.write_text(ROS2)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    return program.with_name("asked")


def test_keys_are_made_once_and_enforced(ros2: Path, tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    environment = secured(HERE, keys)
    assert environment == {
        **HERE,
        "ROS_SECURITY_KEYSTORE": str(keys),
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_ENCLAVE_OVERRIDE": "/ppc_attitude",
    }
    assert secured(HERE, keys) == environment
    assert ros2.read_text().splitlines() == [
        f"security create_keystore {keys}",
        f"security create_enclave {keys} /ppc_attitude",
    ]


def test_keys_are_for_the_domain_in_which_they_were_made(ros2: Path, tmp_path: Path) -> None:
    """SROS 2 permits no other; a run takes it unless the user has set one."""
    keys = tmp_path / "keys"
    assert domain_of(keys) == ""
    secured(HERE, keys)
    assert domain_of(keys) == "7"
    with pytest.raises(ConfigurationError, match=r"_DOMAIN_ID = 8; allowed with --secure .*: 7, "):
        secured(HERE | {"ROS_DOMAIN_ID": "8"}, keys)


def test_without_the_means_to_make_keys_nothing_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigurationError, match="`ros2 security`, which makes keys, is not inst"):
        secured(HERE, tmp_path / "keys")
    assert not (tmp_path / "keys").exists()


def test_keys_that_cannot_be_made_are_told(tmp_path: Path, ros2: Path) -> None:
    ros2.with_name("ros2").write_text("#!/bin/sh\necho no room >&2\nexit 1\n")
    with pytest.raises(ConfigurationError, match="ros2 security create_keystore: no room"):
        secured(HERE, tmp_path / "keys")


@pytest.mark.ros
def test_a_run_without_the_security_that_is_asked_for_does_not_begin(
    ros2: Path, tmp_path: Path, start_process: StartProcess
) -> None:
    """No middleware can enforce these keys, with plugins or without: their files are empty."""
    run = Run(start_process, tmp_path / "bag", "--secure", str(tmp_path / "keys"))
    assert run.ends() == 2
    assert "Traceback" not in run.err
    *_, reason = run.err.splitlines()
    assert reason.startswith("error: ")
    assert "ended with exit code 2: error creating node: " in reason
    assert not run.bag.exists()
