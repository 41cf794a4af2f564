"""The control laws by name. A new law is one file beside this one, and one line here."""

from ppc_attitude.science.controllers import log_barrier, ppc, quaternion_feedback
from ppc_attitude.science.controllers.interface import Controller
from ppc_attitude.science.parameter import Parameter

CONTROLLERS: dict[str, Controller] = {
    law.name: law
    for law in (
        ppc.CONTROLLER,
        log_barrier.CONTROLLER,
        quaternion_feedback.CONTROLLER,
    )
}


def all_parameters() -> tuple[Parameter, ...]:
    """Parameters of all laws, each once: what the controller node declares."""
    merged: dict[str, Parameter] = {}
    for law in CONTROLLERS.values():
        for parameter in law.parameters:
            if merged.setdefault(parameter.name, parameter) != parameter:
                raise AssertionError(f"two laws declare {parameter.name} differently")
    return tuple(merged.values())
