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

"""A law as a craft flies it: behind a rate observer, and without torque while nothing is known.

Every law gets this front. Without `rate_observer`, or with an observer of its own, a law is told
what was measured, and its torque is passed on unchanged. Without an attitude (a zero quaternion)
the torque is zero and the law is not stepped: it begins at the first estimate.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numba
import numpy as np

from ppc_attitude.science.component import Component
from ppc_attitude.science.controllers.common import INERTIA, MAX_TORQUE
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import store, vector
from ppc_attitude.science.part import configured
from ppc_attitude.science.rate_observer import (
    MEMORY,
    OBSERVER,
    PARAMETERS,
    compensate,
    observe,
    observer_record,
)
from ppc_attitude.science.signals import TOLD


def _step_of(law: Component) -> Any:
    """Step of a law behind the observer."""
    step = law.step

    def observed(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
        q = inputs.attitude
        if q[0] == 0.0 and q[1] == 0.0 and q[2] == 0.0 and q[3] == 0.0:
            store(outputs.torque_command, (0.0, 0.0, 0.0))
            state.observer.started = 0.0  # its last torque does not act over the gap
            return
        if configuration.observer.frequency == 0.0:
            step(inputs, state.law, configuration.law, outputs)
            return
        rate = observe(
            configuration.observer, state.observer, inputs.stamp_ns, vector(inputs.angular_velocity)
        )
        store(inputs.angular_velocity, rate)
        step(inputs, state.law, configuration.law, outputs)
        torque = compensate(configuration.observer, state.observer, vector(outputs.torque_command))
        store(outputs.torque_command, torque)

    # The machine code is cached where the law's own is; this closure is not cached by itself.
    observed.__module__ = step.__module__
    return numba.njit(error_model="numpy")(observed)


def with_front(law: Component) -> Component:
    """Put the observer before a law, and the disturbance estimate after it."""
    configuration = np.dtype([("observer", OBSERVER), ("law", law.configuration)], align=True)

    def configure(values: Mapping[str, Any]) -> Any:
        inner, kept = configured(law, values)
        record = np.zeros((), configuration)[()]
        if values["rate_observer"] > 0.0 and not law.observes:
            inertia = inertia_matrix("inertia", values["inertia"])
            record["observer"] = observer_record(values, inertia)
        record["law"] = inner
        return (record, *kept)

    own = (*PARAMETERS, INERTIA, MAX_TORQUE)
    names = {parameter.name for parameter in own}
    return replace(
        law,
        parameters=(*own, *(each for each in law.parameters if each.name not in names)),
        configure=configure,
        configuration=configuration,
        inputs=(*law.inputs, *(column for column in TOLD if column not in law.inputs)),
        state=np.dtype([("observer", MEMORY), ("law", law.state)], align=True),
        step=_step_of(law),
        advice=lambda state: law.advice(state["law"]),
        advices=lambda state: law.advices(state["law"]),
    )
