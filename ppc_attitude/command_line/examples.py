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

"""Every command in the order of the help, with the examples of its own; a test parses each."""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "run": (
        "ppc_attitude run",
        "ppc_attitude run --config config/paper.yaml --config config/sudden_disturbance.yaml",
        "ppc_attitude run --realtime --duration 30 --bag bags/here --report here.html",
    ),
    "simulate": (
        "ppc_attitude simulate --config config/paper.yaml --json",
        "ppc_attitude simulate --controller quaternion_feedback --report simulated.html",
        "ppc_attitude simulate --duration 30 --bag bags/simulated --export simulated.csv",
    ),
    "analyse": (
        "ppc_attitude analyse bags/here",
        "ppc_attitude analyse bags/here --figures figures --report here.html",
        "ppc_attitude analyse bags/here --requirements config/requirements.yaml",
        "ppc_attitude analyse bags/comparison --namespace /proposed --json",
        "ppc_attitude analyse bags/rig --topic attitude=/imu/data --topic "
        "angular_velocity=/imu/data",
    ),
    "compare": (
        "ppc_attitude compare bags/proposed bags/traditional --figures figures",
        "ppc_attitude compare bags/comparison",
        "ppc_attitude compare bags/one bags/two bags/three --report comparison.html",
    ),
    "sweep": (
        "ppc_attitude sweep --torque 0.8 --at 80 --pulse-durations 0.05 0.1 0.2",
        "ppc_attitude sweep --figure sweep.png --json",
    ),
    "check": (
        "ppc_attitude check --config config/paper.yaml --json",
        "ppc_attitude check --config config/paper.yaml --config config/guaranteed.yaml",
    ),
    "design": (
        "ppc_attitude design --config config/paper.yaml --output gains.yaml",
        "ppc_attitude design --config config/paper.yaml --assume e_S=0.1 --assume eta=0.8",
        "ppc_attitude design --attitude-noise 5e-5 --rate-noise 2e-5 --torque-noise 7e-4",
        "ppc_attitude design --config config/paper.yaml --gains 1 15 0.2",
    ),
    "falsify": (
        "ppc_attitude falsify --config config/paper.yaml --config config/guaranteed.yaml",
        "ppc_attitude falsify --controller ppc --goal attitude_error --seconds 60 --out search",
    ),
    "campaign": (
        "ppc_attitude campaign --campaign config/campaign.yaml --runs 1000 --seed 1",
        "ppc_attitude campaign --campaign config/campaign.yaml --only 17",
    ),
    "replay": ("ppc_attitude replay bags/here",),
    "inject": (
        "ROS_DOMAIN_ID=42 ppc_attitude inject 0.5 0.5 0.5",
        "ROS_DOMAIN_ID=42 ppc_attitude inject 0 -0.2 0 --at 60 --duration 0.5",
    ),
    "goto": (
        "ROS_DOMAIN_ID=42 ppc_attitude goto --euler 0 0 90",
        "ROS_DOMAIN_ID=42 ppc_attitude goto --quaternion 0 0 0 1 --frame nadir --at 60",
        "ROS_DOMAIN_ID=42 ppc_attitude goto --vectors 0 0 1 1 0 0 1 0 0 0 0 1",
    ),
    "watch": (
        "ROS_DOMAIN_ID=42 ppc_attitude watch",
        "ROS_DOMAIN_ID=42 ppc_attitude watch --once --namespace /proposed",
    ),
    "latency": (
        "ppc_attitude latency --config config/paper.yaml --rate 250 --duration 20",
        "ppc_attitude latency --live --duration 10",
    ),
    "recover": ("ppc_attitude recover bags/cut",),
    "export": (
        "ppc_attitude export bags/here --parquet here.parquet",
        "ppc_attitude export bags/here --csv here.csv",
    ),
}


def epilog(command: str) -> str:
    """Return the text below the help of a command."""
    return "\n".join(["examples:", *(f"  {line}" for line in EXAMPLES[command])])
