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

"""Records as the kernels take them."""

from typing import Any

import numpy as np

from ppc_attitude.science.component import Component


def new_record(dtype: Any) -> Any:
    """Return a record of zeros."""
    return np.zeros((), dtype)[()]


def inputs_of(component: Component) -> Any:
    """Return what a component's step reads, all zero."""
    return new_record(component.input_record)


def state_of(component: Component) -> Any:
    """Return what a component remembers before its first step."""
    return new_record(component.state)


def outputs_of(component: Component) -> Any:
    """Return what a component's step fills, all zero."""
    return new_record(component.output_record)
