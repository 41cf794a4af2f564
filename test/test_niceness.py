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

"""Who comes after others when the processor is shared."""

import subprocess
import sys

import pytest
from conftest import StartProcess
from process_helpers import niceness

LAST = "from ppc_attitude.processes.child import come_last; come_last(); print('so'); input()"
STARTS = "import subprocess, sys; subprocess.run([sys.executable, '-c', *sys.argv[1:]])"


NICE = "import os, sys; os.nice(7); os.execv(sys.executable, [sys.executable, '-c', *sys.argv[1:]])"


@pytest.mark.parametrize(
    ("words", "expected"), [((LAST,), [5]), ((STARTS, LAST), [0]), ((NICE, LAST), [5, 12])]
)
def test_who_comes_last_leaves_the_session_of_others_alone(
    words: tuple[str, ...], expected: list[int], start_process: StartProcess
) -> None:
    """A session of one's own comes last as a whole; that of a terminal holds others as well.

    What the user runs at a niceness of 7 comes after that, and not before it.
    """
    process = start_process([sys.executable, "-c", *words], stdin=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == "so\n"
    assert niceness(process.pid) == expected
