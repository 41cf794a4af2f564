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

"""A process of a campaign: it runs the chunks that are asked for through a pipe."""

import contextlib
import gc
import sys
from multiprocessing.connection import Connection

from ppc_attitude.campaign.rows import Outcome, loop_of, run_chunk


def main() -> int:
    """Take the campaign, then compute chunks, until the pipe of a descriptor is closed."""
    connection = Connection(int(sys.argv[1]))
    gc.freeze()  # what has been imported stays
    gc.disable()  # what runs leave behind is collected between chunks
    with contextlib.suppress(EOFError, OSError):
        campaign, loop = connection.recv(), None
        while True:
            start, stop = connection.recv()
            answer: list[Outcome] | Exception
            try:
                loop = loop or loop_of(campaign)
                answer = run_chunk(campaign, start, stop, loop)
            except Exception as error:
                answer = error
            connection.send(answer)
            gc.collect()
    return 0
