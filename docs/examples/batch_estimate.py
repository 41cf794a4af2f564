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

"""Compare the filter's last estimate with GTSAM's batch estimate of the same recording.

python docs/examples/batch_estimate.py GYRO.csv STAR.csv --config config/sensors_smallsat.yaml

The files are those of recorded_sensors.py. GTSAM (`pip install gtsam`) smooths all fixes at once: a
pre-integrated factor of the gyro between two fixes, a random walk of the bias, a prior for each
fix. The last estimate of a filter and of a batch are the same but for what is not linear.
"""

import math
import runpy
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, R

RECORDED: dict[str, Any] = runpy.run_path(str(Path(__file__).with_name("recorded_sensors.py")))


def rotation(q: Any) -> Any:
    """Rotation of a quaternion x y z w."""
    return gtsam.Rot3.Quaternion(q[3], q[0], q[1], q[2])


def batch(
    values: Mapping[str, Any], rates: Any, star: Any, rate: float
) -> tuple[Any, Any, Any, Any]:
    """Attitude and bias at the last step, and the covariances of both [rad²], [rad²/s²].

    It takes what `estimates` of recorded_sensors.py takes, and every fix.
    """
    step, count = 1.0 / rate, len(rates)
    resolution = values["gyro.resolution"]
    white = values["gyro.angular_random_walk"] ** 2 + resolution**2 / 12.0 * step
    walk = values["gyro.rate_random_walk"]
    mounting = rotation(values["star_tracker.mounting"])
    across, about = values["star_tracker.cross_noise"], values["star_tracker.boresight_noise"]
    axes = mounting.matrix()
    covariance = axes @ np.diag(np.square([across, across, about])) @ axes.T
    # Not "smart": below 1e-9 that takes what is off the diagonal for zero.
    of_fix = gtsam.noiseModel.Gaussian.Covariance(covariance, smart=False)
    settings = gtsam.PreintegrationParams(np.zeros(3))
    settings.setGyroscopeCovariance(white * np.eye(3))

    graph, guess = gtsam.NonlinearFactorGraph(), gtsam.Values()
    arrived = star[star[:, 1] <= count]
    fixes = {int(row[0]): rotation(row[2:]).compose(mounting.inverse()) for row in arrived}
    for k, fix in fixes.items():
        graph.add(gtsam.PriorFactorRot3(R(k), fix, of_fix))
        guess.insert(R(k), fix)
    steps = sorted({*fixes, count})
    bias_sigma = gtsam.noiseModel.Isotropic.Sigma(3, values["gyro.initial_bias_sigma"])
    graph.add(gtsam.PriorFactorPoint3(B(steps[0]), np.zeros(3), bias_sigma))
    bias = np.zeros(3)
    for i, j in pairwise(steps):
        measured = gtsam.PreintegratedAhrsMeasurements(settings, bias)
        for sample in rates[i:j]:
            measured.integrateMeasurement(sample, step)
        graph.add(gtsam.AHRSFactor(R(i), R(j), B(i), measured))
        of_walk = gtsam.noiseModel.Isotropic.Sigma(3, walk * math.sqrt((j - i) * step))
        graph.add(gtsam.BetweenFactorPoint3(B(i), B(j), np.zeros(3), of_walk))
    for k in steps:
        guess.insert(B(k), bias)
    if count not in fixes:
        guess.insert(R(count), fixes[max(fixes)])
    found = gtsam.LevenbergMarquardtOptimizer(graph, guess).optimize()
    sure = gtsam.Marginals(graph, found)
    attitude = found.atRot3(R(count))
    return attitude, found.atPoint3(B(count)), *map(sure.marginalCovariance, (R(count), B(count)))


def main() -> None:
    """Print how far the two are from each other."""
    fed = RECORDED["recording"](RECORDED["arguments_of"](__doc__))
    last = list(RECORDED["estimates"](*fed))[-1]
    attitude, bias, of_attitude, of_bias = batch(*fed)
    sigmas = np.sqrt([np.diag(of_attitude), np.diag(of_bias)])
    error = gtsam.Rot3.Logmap(attitude.between(rotation(last[:4])))
    for name, apart, sigma, told in (
        ("attitude", error, sigmas[0], last[7:10]),
        ("bias", np.array(last[4:7]) - bias, sigmas[1], last[10:13]),
    ):
        print(
            f"{name}: {np.abs(apart / sigma).max():.1e} σ apart, σ differ by at most "
            f"{np.abs(np.array(told) / sigma - 1.0).max():.1e} of themselves"
        )


if __name__ == "__main__":
    main()
