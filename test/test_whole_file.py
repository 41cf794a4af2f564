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

"""A file that is there as a whole, or not at all."""

import os
from errno import ENOSPC
from pathlib import Path

import pytest

from ppc_attitude.contract.whole_file import whole_file, write_whole


def test_a_file_is_as_it_was_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "not" / "yet" / "there.txt"
    write_whole(path, "first")

    def break_off() -> None:
        with whole_file(path) as file:
            file.write(b"half of the second")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_off()
    assert path.read_text() == "first"
    write_whole(path, "second")
    assert path.read_text() == "second"
    assert list(path.parent.iterdir()) == [path]


def test_two_that_write_one_file_each_write_a_whole_one(tmp_path: Path) -> None:
    path, mine = tmp_path / "report.html", tmp_path / "report.html.unfinished"
    mine.write_text("years of work")
    with whole_file(path) as first:
        first.write(b"first")
        write_whole(path, "second")
        assert path.read_text() == "second"
    assert path.read_text() == "first"
    assert mine.read_text() == "years of work"
    assert {*tmp_path.iterdir()} == {path, mine}


@pytest.mark.parametrize(("known", "told"), [((), "report.html"), (("figure.svg",), "figure.svg")])
def test_a_disk_that_is_full_is_told_with_the_file_that_it_has_no_room_for(
    tmp_path: Path, known: tuple[str, ...], told: str
) -> None:
    """That is the file that the error names, if it names one."""
    with pytest.raises(OSError) as full, whole_file(tmp_path / "report.html"):
        raise OSError(ENOSPC, os.strerror(ENOSPC), *(str(tmp_path / each) for each in known))
    assert full.value.filename == str(tmp_path / told)
    assert not list(tmp_path.iterdir())
