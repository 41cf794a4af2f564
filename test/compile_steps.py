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

"""Compile the step of every component, two at a time: `make test` does so while it lints.

Otherwise the tests that need a step first, and the processes that they start, would compile it side
by side, each for itself.
"""

from multiprocessing import Pool

from ppc_attitude.science.kinds import all_components
from ppc_attitude.science.part import entry_point

COMPONENTS = list(all_components())


def compile_step(number: int) -> None:
    """Compile one step; what is compiled is in the cache then."""
    entry_point(COMPONENTS[number])


if __name__ == "__main__":
    with Pool(2) as pool:
        pool.map(compile_step, range(len(COMPONENTS)), chunksize=1)
