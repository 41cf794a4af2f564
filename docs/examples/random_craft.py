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

"""Design the momentum-tube law for random craft, and attack what is certified.

python docs/examples/random_craft.py --craft 100

Every craft goes through `ppc_attitude design` as a user's would: a parameter file and assumptions.
It is either refused with the reason, or certified; then the adversary looks for a run that breaks
what the certificate promises.
"""

import argparse
import io
import math
import re
import threading
import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from ppc_attitude.command_line.guarantee_view import stored_certificate
from ppc_attitude.command_line.main import main as ppc_attitude
from ppc_attitude.falsify.goals import goal_of
from ppc_attitude.falsify.search import Search
from ppc_attitude.falsify.space import Space
from ppc_attitude.science.controllers.tube_parameters import PREFIX
from ppc_attitude.simulation.scenario import load

PAPER = Path(__file__).parents[2] / "config" / "paper.yaml"
CERTIFIED, REFUSED = "certified", "refused"
# Share of the promised time after which a goal is judged; Φ is φ itself at the start.
_AFTER = {"turn": 0.1, "rate": 0.5}
_MOST_SAMPLES = 200_000  # of a run of the adversary
_PIECES = 12  # of the disturbance


@dataclass(frozen=True)
class Outcome:
    """What became of one craft.

    Attributes
    ----------
    verdict : str
        ``certified``, ``refused``, or what went wrong.
    reason : str
        Why it was refused.
    seconds : float
        Processor time of the design [s].
    largest : mapping of str to float
        Of each goal, the largest value that the adversary found, as a share of what is promised.
    runs : int
        Of the adversary.
    """

    verdict: str
    reason: str
    seconds: float
    largest: Mapping[str, float] = field(default_factory=dict)
    runs: int = 0


def craft_of(seed: int) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Draw a craft: parameters of its nodes, and options of `design`.

    The inertia covers four decades; torque, disturbance, dead band, limits, rates and errors are
    drawn relative to it so widely that many craft are impossible.
    """
    stream = np.random.default_rng([15, seed])

    def decades(low: float, high: float) -> float:
        return float(f"{10.0 ** stream.uniform(math.log10(low), math.log10(high)):.4g}")

    def sometimes(share: float, value: float) -> float:
        return value if stream.uniform() < share else 0.0

    extents = stream.uniform(0.2, 1.0, 3)  # of a body: its moments keep the triangle inequality
    moments = extents[[1, 2, 0]] + extents[[2, 0, 1]]
    moments *= decades(1e-2, 1e2) / moments.max()
    axes = np.eye(3)
    if stream.uniform() < 0.5:  # the craft's axes are not its principal ones
        axes = Rotation.from_rotvec(stream.normal(0.0, 0.3, 3)).as_matrix()
    inertia = axes @ np.diag(moments) @ axes.T
    inertia = np.round(0.5 * (inertia + inertia.T), 9)
    torque = decades(1e-3, 0.3) * float(moments.max())  # [rad/s²] times inertia
    limit = math.radians(decades(0.5, 10.0))
    speed = limit * float(stream.uniform(0.0, 0.6))
    disturbance = torque * decades(1e-3, 0.5)
    turned = stream.normal(size=3)
    body = {"inertia": inertia.ravel().tolist(), "max_torque": torque}
    noise = {
        "attitude_noise": sometimes(0.5, decades(1e-7, 1e-4)),
        "rate_noise": sometimes(0.5, decades(1e-8, 1e-4)),
    }
    late = bool(stream.uniform() < 0.15)
    nodes = {
        "spacecraft_plant": {
            **body,
            **noise,
            "min_torque": torque * decades(1e-5, 1e-2),
            "rate": float(stream.choice([10.0, 20.0, 50.0, 100.0, 250.0])),
            "late_command": late,
        },
        "reference_generator": {
            "amplitude": (speed * turned / np.linalg.norm(turned)).tolist(),
            "period_constant": [decades(10.0, 1000.0) for _ in range(3)],
        },
        "disturbance_injector": {"environment": False},
        "ppc_controller": body,
    }
    assumed = {
        "Omega": limit,
        "d": disturbance,
        "eta": 1.0 - sometimes(0.3, float(stream.uniform(0.0, 0.3))),
        "e_S": sometimes(0.3, float(stream.uniform(0.0, 0.15))),
    }
    options = [f"--assume={name}={value!r}" for name, value in assumed.items()]
    return nodes, [*options, f"--rate={math.degrees(limit) / 4.0:.4g}"]


def outcome_of(seed: int, seconds: float) -> Outcome:
    """Design for a craft, and attack what is certified for so long with each goal [s]."""
    nodes, options = craft_of(seed)
    with TemporaryDirectory() as name:
        folder = Path(name)
        craft, gains = folder / "craft.yaml", folder / "gains.yaml"
        written = {f"/**/{node}": {"ros__parameters": values} for node, values in nodes.items()}
        craft.write_text(yaml.safe_dump(written), encoding="utf-8")
        files = [PAPER, craft]
        told, wrong = io.StringIO(), io.StringIO()
        begin = time.process_time()
        with redirect_stdout(told), redirect_stderr(wrong):
            command = ["design", *(f"--config={each}" for each in files), *options]
            code = ppc_attitude([*command, f"--output={gains}"])
        spent = time.process_time() - begin
        if code == 1:
            return Outcome(REFUSED, told.getvalue().strip(), spent)
        if code != 0:
            return Outcome(f"exit code {code}: {told.getvalue()}{wrong.getvalue()}", "", spent)
        largest, runs = attacked([*files, gains], folder, seconds)
        return Outcome(CERTIFIED, "", spent, largest, runs)


def attacked(files: list[Path], folder: Path, seconds: float) -> tuple[dict[str, float], int]:
    """Largest value of each goal that the adversary finds, as a share of its limit; and runs."""
    base = load(files)
    values = base.parameters["ppc_controller"]
    assumed = {
        name.removeprefix(f"{PREFIX}assumed."): float(value)
        for name, value in values.items()
        if name.startswith(f"{PREFIX}assumed.")
    }
    certificate = stored_certificate(files)
    assert certificate is not None
    promise = certificate["promises"][-1]
    rate = base.number("spacecraft_plant", "rate")
    duration = min(1.2 * promise["time"] + 10.0, _MOST_SAMPLES / rate)
    space = Space(
        load(files, {"spacecraft_plant": {"duration": duration}}),
        rate=math.radians(promise["rate"]),
        disturbance=assumed["d"],
        pieces=_PIECES,
        e_S=assumed["e_S"],
        eta=assumed["eta"],
        begin=1000.0,
        late=assumed["late"] > 0.0,
    )
    found, runs = {}, 0
    for name in ("turn", "momentum_error", "rate", "settling"):
        after = _AFTER.get(name, 0.0) * promise["time"]
        goal = goal_of(name, base, certificate["accuracy"], after)
        limit = {"settling": promise["time"], "rate": math.degrees(assumed["Omega"])}
        search = Search(space, goal, folder / name, seed=1)
        with ThreadPoolExecutor(1) as thread:
            *_, last = search.run(1_000_000, seconds, thread, threading.Event())
        found[name], runs = last.value / limit.get(name, 1.0), runs + last.runs
    return found, runs


def main() -> None:
    """Print what became of each craft, then how many were certified and how near the limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--craft", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--seconds", type=float, default=3.0, help="of each of four attacks")
    given = parser.parse_args()
    found = []
    for seed in range(given.first, given.first + given.craft):
        each = outcome_of(seed, given.seconds)
        found.append(each)
        told = ", ".join(f"{name} {share:.3f}" for name, share in each.largest.items())
        first = each.reason.split("\n")[0]
        print(f"{seed}: {each.verdict} in {each.seconds:.1f} s {told}{first}", flush=True)
    print(Counter(each.verdict for each in found))
    print(Counter(_failing(each.reason) for each in found if each.verdict == REFUSED))
    slowest = max(each.seconds for each in found)
    print(f"slowest design {slowest:.1f} s, {sum(each.runs for each in found)} runs of adversary")
    for name in ("turn", "momentum_error", "rate", "settling"):
        shares = [each.largest[name] for each in found if each.largest]
        if shares:
            print(f"{name}: largest {max(shares):.4f}, median {np.median(shares):.3f}")


def _failing(reason: str) -> str:
    """Name of the inequality that a refusal gives, or the wish."""
    found = re.search(r"C\d+", reason)
    return found[0] if found else reason.split("\n")[0]


if __name__ == "__main__":
    main()
