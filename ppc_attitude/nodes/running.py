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

"""Running a node: from the command line to its exit code."""

import gc
import json
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from textwrap import fill, indent

import rclpy
import rclpy.utilities
from rclpy.exceptions import NameValidationException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.discovery import tune_transport
from ppc_attitude.processes.child import handle_ending, take_signals
from ppc_attitude.processes.exits import BAD_INPUT, BROKEN, DONE, is_full
from ppc_attitude.processes.leaving import leaving
from ppc_attitude.processes.telling import tell_broken
from ppc_attitude.science.errors import ConfigurationError

# To spin until a future is done spares lock-step a fifteenth of its time, but each such call of the
# events executor leaks 32 bytes, 2.7 GB a day in a node that wakes at 1 kHz. So it is used in full
# flow alone, when a node wakes ten times a second: there the leak is 27 MB a day.
_LOOK, _FLOW = 0.1, 60  # [s], and messages within that time
RCLError: type[Exception] = rclpy_implementation.RCLError


def stop_requests() -> list[int]:
    """Return a list that collects signals that ask for an end: a node ends between two messages."""
    requests: list[int] = []
    handle_ending(lambda number, frame: requests.append(number))
    take_signals()
    return requests


def run_node(make: type[BaseNode], arguments: Sequence[str] | None = None) -> int:
    """Run a node until it has finished or is asked to stop; the `main` of every executable.

    Returns
    -------
    int
        Exit code: 0 done, 2 bad configuration, 3 the node broke or had no room for a file.
    """
    stop = stop_requests()
    command_line = list(arguments or sys.argv)
    try:
        tune_transport()
        strange = rclpy.utilities.remove_ros_args(command_line)[1:]
        if {"-h", "--help"} & set(strange):
            print(help_text(make.executable, sys.modules[make.__module__].__doc__ or ""))
            return DONE
        if strange:
            told = f"argument {strange[0]}; allowed: --help, or arguments of ROS after --ros-args"
            raise ConfigurationError(told)
        rclpy.init(args=command_line, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rcl raises many types for a bad argument or parameter file
        return _refused(error)
    node, code = None, DONE
    try:
        if not stop:
            with refusals_of_ros():
                node = make()
            # rclpy's first line looks for its caller in every module, 30 ms: not amid the steps.
            node.get_logger().info("ready")
            _spin(node, stop)
            code = node.exit_code
    except ConfigurationError as error:
        code = _refused(error)
    except Exception as error:
        tell_broken(f"{type(error).__name__}: {error}")
        traceback.print_exc()
        code = BROKEN
    with leaving(code):
        if node is not None:
            node.destroy_node()
        rclpy.utilities.try_shutdown()
    handle_ending(signal.SIG_IGN)  # an interpreter that ends would die of a request
    return code


@contextmanager
def refusals_of_ros() -> Iterator[None]:
    """Raise ConfigurationError for what ROS refuses: no place for logs, or invalid keys."""
    try:
        yield
    except RCLError as error:
        raise ConfigurationError(" ".join(str(error).split())) from error


def check_name(validate: Callable[[str], bool], name: str, what: str) -> None:
    """See that ROS takes a name.

    Raises
    ------
    ConfigurationError
        It does not; says what of, and why.
    """
    try:
        validate(name)
    except NameValidationException as error:
        reason = str(error).partition("\n")[0].rstrip(":")
        raise ConfigurationError(f"{what}: {reason}") from None


def help_text(executable: str, what: str) -> str:
    """Say what a node is, how it is run, and its parameters; 80 columns."""
    lines = [
        fill(" ".join(what.split()), 80),
        f"\nusage: ros2 run ppc_attitude {executable} [--ros-args",
        "           [--params-file FILE] [-p PARAMETER:=VALUE] [-r __ns:=/NAMESPACE] …]",
        "\nparameters:",
    ]
    for each in PARAMETERS[executable]:
        unit = f" [{each.unit}]" if each.unit else ""
        default = json.dumps(each.default)
        about = f"{each.description}{unit}; default {default}, allowed: {each.allowed}"
        lines += [f"  {each.name}", indent(fill(about, 74), 6 * " ")]
    return "\n".join(lines)


def _refused(error: Exception) -> int:
    reason = " ".join(str(error).split())
    tell_broken(reason)
    print(f"error: {reason}", file=sys.stderr)
    return BROKEN if is_full(error.__cause__) else BAD_INPUT


def _spin(node: BaseNode, stop: list[int]) -> None:
    executor = node.new_executor()
    executor.add_node(node)
    node.is_asked_to_end = lambda: bool(stop)
    # What exists now stays: a collection that walks through all of it would cost milliseconds.
    gc.freeze()
    gc.enable()
    looked, heard, flows = time.monotonic(), 0, False
    try:
        while not (stop or node.finished):
            now = time.monotonic()
            if now >= node.wake_at:
                wait = node.await_recorder() if node.waits else node.wake()
                node.wake_at = now + wait
            if now >= looked + _LOOK:
                flows, looked, heard = node.heard - heard > _FLOW, now, node.heard
            patience = max(0.0, node.wake_at - time.monotonic())
            if flows and patience > 0.5 * _LOOK:
                executor.spin_until_future_complete(node.new_turn(), patience)
            else:
                executor.spin_once(patience)
        node.flush()
        node.drain(executor)
    finally:
        node.close()
        # Until its shutdown an executor holds what it waits for: that would be destroyed only after
        # `leaving`, which bounds the time that an end may take.
        executor.shutdown()
