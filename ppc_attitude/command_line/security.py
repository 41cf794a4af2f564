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

"""SROS 2: keys for a run, and the environment in which no message without them is accepted."""

import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

from ppc_attitude.nodes.discovery import DOMAIN
from ppc_attitude.science.errors import ConfigurationError

_ENCLAVE = "ppc_attitude"


def domain_of(keys: Path) -> str:
    """Return the one ROS domain that the keys in a folder are for; empty if that cannot be told.

    SROS 2 writes it into what all keys of a keystore have in common.
    """
    try:
        governance = (keys / "enclaves" / "governance.xml").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
    found = re.findall(r"<id>\s*([0-9]{1,3})\s*</id>", governance)
    return found[0] if len(found) == 1 else ""


def secured(environment: Mapping[str, str], keys: Path) -> dict[str, str]:
    """Environment of nodes that authenticate and encrypt, made of one in which the domain is set.

    The keys are in a folder, an SROS 2 keystore; they are made if there are none.

    Raises
    ------
    ConfigurationError
        The keys are for another domain, or cannot be made; says why.
    """
    domain = domain_of(keys)
    if domain not in {"", environment[DOMAIN]}:
        raise ConfigurationError(
            f"{DOMAIN} = {environment[DOMAIN]}; allowed with --secure {keys}: {domain}, the domain "
            "for which its keys were made"
        )
    if not (keys / "enclaves").is_dir():
        _make(environment, "create_keystore", str(keys))
    if not (keys / "enclaves" / _ENCLAVE).is_dir():
        _make(environment, "create_enclave", str(keys), f"/{_ENCLAVE}")
    return {
        **environment,
        "ROS_SECURITY_KEYSTORE": str(keys.absolute()),
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_ENCLAVE_OVERRIDE": f"/{_ENCLAVE}",
    }


def _make(environment: Mapping[str, str], *words: str) -> None:
    program = shutil.which("ros2")
    if program is None:
        raise ConfigurationError(
            "--secure: `ros2 security`, which makes keys, is not installed (sros2)"
        )
    done = subprocess.run(
        [program, "security", *words],
        env=environment,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode:
        told = done.stderr or done.stdout
        raise ConfigurationError(f"--secure: ros2 security {words[0]}: {told}")
