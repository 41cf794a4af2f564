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

"""Run the filter over recorded gyro samples and star tracker fixes; print what it knows as CSV.

python docs/examples/recorded_sensors.py GYRO.csv STAR.csv --config config/sensors_smallsat.yaml

GYRO.csv: row k = 1, 2, … is the mean rate of the step that ends at k, body axes; its header ends in
the unit, as "[1e-07 rad/s]". STAR.csv: step of validity, step of arrival, attitude tracker to
inertial x y z w. The configuration has the noise numbers and the tracker's mounting.
"""

import argparse
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ppc_attitude.contract.topics import ESTIMATOR
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.part import Part
from ppc_attitude.science.stamps import NANOSECONDS, stamp_of
from ppc_attitude.simulation.scenario import load

HEAD = "step,qx,qy,qz,qw,bx,by,bz,s1,s2,s3,sb1,sb2,sb3"
_VARIANCES = (4, 7, 9)  # of the attitude, among the numbers of an estimate
_NO_FIX = (0.0,) * 8


def estimates(
    values: Mapping[str, Any], rates: Any, star: Any, rate: float
) -> Iterator[list[float]]:
    """Yield a row for each step from 0 on: q̂, b̂ [rad/s], σ of δθ [rad] and δb [rad/s].

    Parameters
    ----------
    values : mapping
        Parameters of the filter.
    rates : ndarray, shape (n, 3)
        Gyro samples of the steps 1 to n [rad/s].
    star : ndarray, shape (m, 6)
        Rows of STAR.csv.
    rate : float
        Steps per second [Hz].
    """
    part = Part(mekf.COMPONENT, values)
    waiting = sorted(star.tolist(), key=lambda row: row[1])[::-1]  # the next one is the last
    for step, sample in enumerate([np.zeros(3), *rates]):
        stamp, fix = stamp_of(step, rate), _NO_FIX
        if waiting and waiting[-1][1] <= step:  # one at an instant: a second one waits
            valid, _, *attitude = waiting.pop()
            age = (stamp - stamp_of(int(valid), rate)) / NANOSECONDS
            fix = (*attitude, 0.0, 0.0, 0.0, age)
        part.step(stamp, (*sample, 0.0, *fix))
        estimate = part.output("estimate")
        if estimate[4] < 0.0:  # no estimate yet
            yield [np.nan] * 13
            continue
        sigmas = [math.sqrt(estimate[place]) for place in _VARIANCES]
        yield [*estimate[:4], *part.output("gyro_bias"), *sigmas, *part.output("gyro_bias_sigma")]


def read_gyro(path: Path) -> Any:
    """Gyro samples [rad/s] of a file."""
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    unit = re.search(r"\[(\S+) rad/s\]", head)
    if unit is None:
        raise ValueError(f"{path}: the header {head!r} has no unit as [1e-07 rad/s]")
    return np.genfromtxt(rows, delimiter=",").reshape(-1, 3) * float(unit[1])


def arguments_of(text: str) -> argparse.Namespace:
    """Arguments of the command line of a script that does what the text says."""
    parser = argparse.ArgumentParser(description=text.splitlines()[0])
    parser.add_argument("gyro", type=Path)
    parser.add_argument("star", type=Path)
    parser.add_argument("--config", type=Path, action="append", required=True)
    parser.add_argument("--rate", type=float, default=100.0, help="steps per second [Hz]")
    return parser.parse_args()


def recording(arguments: argparse.Namespace) -> tuple[Mapping[str, Any], Any, Any, float]:
    """Parameters of the filter, gyro samples, rows of STAR.csv, and steps per second."""
    # Of a file of one row NumPy makes a row, not a table.
    star = np.genfromtxt(arguments.star, delimiter=",", skip_header=1).reshape(-1, 6)
    values = load(arguments.config).parameters[ESTIMATOR]
    return values, read_gyro(arguments.gyro), star, arguments.rate


def main() -> None:
    """Print the estimates of a recording."""
    fed = recording(arguments_of(__doc__))
    print(HEAD)
    for step, row in enumerate(estimates(*fed)):
        print(step, *(f"{number:.12g}" for number in row), sep=",")


if __name__ == "__main__":
    main()
