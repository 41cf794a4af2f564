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

"""Measurements of this stack beside a yardstick: `python -m bench`, in the repository's root."""

import statistics
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]  # where processes find this package, which is not installed
SENSORS = ROOT / "config" / "sensors_smallsat.yaml"  # of the rows with sensors


def alternating(pairs: int, *measures: Callable[[], float]) -> tuple[float, ...]:
    """Call every measure in turn, so that all see the same machine; return the median of each.

    There are `pairs` rounds, at least one.
    """
    rounds = [tuple(measure() for measure in measures) for _ in range(pairs)]
    return tuple(statistics.median(figures) for figures in zip(*rounds, strict=True))
