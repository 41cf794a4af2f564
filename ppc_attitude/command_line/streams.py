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

import codecs
import io
import os
import sys
import unicodedata

# What a terminal without a letter shows in its place.
_INSTEAD = {
    "≤": "<=",
    "≥": ">=",
    "≈": "~",
    "·": "*",
    "–": "-",
    "−": "-",
    "…": "...",
    "°": "deg",
    "²": "^2",
    "³": "^3",
    "×": "x",
    "±": "+/-",
    "√": "sqrt",
    "∞": "inf",
    "‖": "||",
    "\u0304": "_bar",  # over the letter before it
}


def _word(letter: str) -> str:
    if letter in _INSTEAD:
        return _INSTEAD[letter]
    kind, _, name = unicodedata.name(letter, "").partition(" LETTER ")
    if kind.startswith("GREEK"):
        return name.lower() if kind.endswith("SMALL") else name.capitalize()
    return f"\\u{ord(letter):04x}"


def _spelt(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    letters = error.object[error.start : error.end]
    return "".join(map(_word, letters)), error.end


class _Forgiving(io.TextIOWrapper):
    """An outlet that nobody reads stops nothing; it writes through, so no flush can fail."""

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError:
            return len(text)


def prepare_streams() -> None:
    """Let this process write whatever its output and error are.

    A closed one becomes `/dev/null`: else the next file that is opened takes its place, and gets
    what was to be said. Standard error never fails; standard output does, for results count.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free: this one
    codecs.register_error("ppc_attitude", _spelt)
    sys.stdout = sys.stdout or os.fdopen(1, "w", encoding="utf-8", closefd=False)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="ppc_attitude")
    error = os.fdopen(2, "wb", buffering=0, closefd=False)
    encoding = sys.stderr.encoding if sys.stderr else "utf-8"
    sys.stderr = _Forgiving(error, encoding, "ppc_attitude", write_through=True)


def give_up_output() -> None:
    """Discard everything that is still to be written to standard output."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
