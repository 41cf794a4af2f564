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

"""What a run was made with."""

import pytest
from craft_helpers import ROOT
from process_helpers import ran

from ppc_attitude.contract.versions import versions


def test_the_git_revision_is_that_of_the_checkout() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout of git")
    asked = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
    revision = ran(asked).stdout.strip()
    assert versions()["git_revision"].removesuffix("-dirty").endswith(revision)
