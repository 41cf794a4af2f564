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

"""Runs a second of a campaign, beside Basilisk's own Monte Carlo with its compiled law."""

import json
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

from bench import SENSORS, alternating
from ppc_attitude.campaign.pools import cores
from ppc_attitude.simulation.scenario import load

DURATION = 120.0  # [s] of one run
_SPREAD = 0.001  # [rad/s] by which Basilisk's runs differ at their start


def ours_runs_per_s(runs: int, *files: Path) -> float:
    """Runs a second of the command on all cores: start of the processes, verdicts, tables.

    The files are the ROS parameter files of the case.
    """
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        command = [sys.executable, "-m", "ppc_attitude.command_line.main", "campaign"]
        command += ["--runs", str(runs), "--seed", "1", "--duration", str(DURATION)]
        command += ["--out", f"{folder}/out", "--json"]
        command += [option for file in files for option in ("--config", str(file))]
        done = subprocess.run(command, capture_output=True, check=False)
        if done.returncode not in (0, 1):
            raise RuntimeError(done.stderr.decode(errors="replace"))
    return float(json.loads(done.stdout)["runs_per_s"])


def create(*files: Path) -> Any:
    """Build one Basilisk simulation of a case that carries its loop."""
    from bench.basilisk_loop import BasiliskLoop

    loop = BasiliskLoop(load(files), DURATION)
    loop.sim.loop = loop
    return loop.sim


def execute(simulation: Any) -> None:
    """Run one Basilisk simulation."""
    simulation.loop.prepare()
    simulation.loop.run()


def basilisk_runs_per_s(runs: int, *files: Path) -> float:
    """Runs a second of `Basilisk.utilities.MonteCarlo` on all cores.

    Nothing is judged or kept: with a retention policy its workers sleep a second after each run.
    """
    from Basilisk.utilities.MonteCarlo.Controller import Controller
    from Basilisk.utilities.MonteCarlo.Dispersions import UniformVectorDispersion

    create(*files)  # once for all forks of this process: imports, compiled models, the table
    controller = Controller()
    controller.setSimulationFunction(partial(create, *files))
    controller.setExecutionFunction(execute)
    controller.addDispersion(
        UniformVectorDispersion("loop.body.hub.omega_BN_BInit", [-_SPREAD, _SPREAD])
    )
    controller.setExecutionCount(runs)
    controller.setThreadCount(cores())
    controller.setShouldDisperseSeeds(False)
    controller.setShowProgressBar(False)
    controller.setVerbose(False)
    begin = time.perf_counter()
    failures = controller.executeSimulations()
    elapsed = time.perf_counter() - begin
    if failures:
        raise RuntimeError(f"Basilisk's runs {failures} failed")
    return runs / elapsed


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``campaign``."""
    runs, others, pairs = (32, 8, 1) if quick else (2_000, 60, 2)
    ours, basilisk, ours_sensing, basilisk_sensing = alternating(
        pairs,
        lambda: ours_runs_per_s(runs),
        lambda: basilisk_runs_per_s(others),
        lambda: ours_runs_per_s(runs, SENSORS),
        lambda: basilisk_runs_per_s(others, SENSORS),
    )
    return {
        **_compared(ours, basilisk),
        "sensors": _compared(ours_sensing, basilisk_sensing),
    }


def _compared(ours: float, basilisk: float) -> dict[str, float]:
    return {"runs_per_s": ours, "basilisk_runs_per_s": basilisk, "ratio": ours / basilisk}
