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

"""Exit codes of the command and of every node, and the error that means one of them."""

from errno import EDQUOT, EFBIG, ENOSPC

DONE = 0
REQUIREMENT_FAILED = 1
BAD_INPUT = 2
BROKEN = 3


class RunError(RuntimeError):
    """The run broke; exit code 3."""


def is_full(error: BaseException | None) -> bool:
    """Whether there was no room for a file, which is no mistake of the input."""
    return isinstance(error, OSError) and error.errno in (ENOSPC, EFBIG, EDQUOT)
