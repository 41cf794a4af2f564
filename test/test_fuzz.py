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

"""What a coverage-guided fuzzer found worth keeping, once more (`fuzz_bags.py`)."""

import zipfile
from pathlib import Path

import pytest
from fuzz_bags import attempt

CORPUS = zipfile.ZipFile(Path(__file__).parent / "fuzz_corpus.zip")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("first", sorted({CORPUS.read(name)[:1] for name in CORPUS.namelist()}))
def test_what_the_fuzzer_found_ends_in_a_result_or_a_clear_error(first: bytes) -> None:
    for name in CORPUS.namelist():
        data = CORPUS.read(name)
        if data[:1] == first:
            try:
                attempt(data)
            except Exception as error:
                pytest.fail(f"{name}: {error!r}")
