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

"""Standard output and error as they may be: closed, full, or of few letters."""

import io
import os
import sys


class _Forgiving(io.TextIOWrapper):
    """A text stream whose failure stops nothing; it writes through, so no flush can fail."""

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError:
            return len(text)


def prepare_streams() -> None:
    """Make standard output and error of this process usable, whatever they are.

    A closed one becomes `/dev/null`: else the next file that is opened would get its number, and
    its text. Standard error never fails; standard output may, because results count. A character
    that the encoding lacks is written as an escape.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free: this one
    sys.stdout = sys.stdout or os.fdopen(1, "w", encoding="utf-8", closefd=False)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    error = os.fdopen(2, "wb", buffering=0, closefd=False)
    encoding = sys.stderr.encoding if sys.stderr else "utf-8"
    sys.stderr = _Forgiving(error, encoding, "backslashreplace", write_through=True)


def give_up_output() -> None:
    """Discard everything that is still to be written to standard output."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
