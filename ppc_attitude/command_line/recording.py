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

"""One run through the five nodes, recorded and read back: what `run` and `campaign` share."""

import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TypeAlias

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.in_process import check_memory
from ppc_attitude.command_line.options import exit_code
from ppc_attitude.command_line.progress import progress_bar
from ppc_attitude.command_line.security import domain_of, secured
from ppc_attitude.command_line.stack import Stack, StackError, private_environment
from ppc_attitude.command_line.stopping import stop_on_signals, stoppable
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import PLANT, RECORDER
from ppc_attitude.contract.whole_file import dated
from ppc_attitude.nodes.discovery import DOMAIN, reach
from ppc_attitude.processes.exits import RunError
from ppc_attitude.processes.telling import BAG
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import Scenario, check_exchange

Watch: TypeAlias = Callable[[Callable[[], bool]], None]
"""A function that works as long as the function that it is given, and keeps calling, is true."""


class Recording:
    """A run through the nodes, and its bag, by default in a new, dated folder.

    With a folder of keys the nodes are secured; keys are made if there are none.
    """

    def __init__(self, bag: Path | None, keys: Path | None = None) -> None:
        self.bag = bag or dated("bags").absolute()
        self.told = f"bag: {self.bag}"
        """Where the bag is, for the user."""
        self._keys = keys
        self._interrupted = False

    def run(
        self, scenario: Scenario, lockstep: bool = True, watch: Watch | None = None
    ) -> RunRecord:
        """Run a scenario, in lock-step or free on the wall clock, and read what was recorded.

        Raises
        ------
        ConfigurationError
            The environment lets no node find another, or names an invalid domain or peer.
        RunError
            The run broke, or its bag cannot be read.
        """
        environment = private_environment(domain_of(self._keys) if self._keys else "")
        if self._keys:
            environment = secured(environment, self._keys)
        check_exchange(scenario.parameters)
        scenario = scenario.awaiting_recorder().with_values(PLANT, lockstep=lockstep)
        scenario = scenario.with_values(RECORDER, bag=str(self.bag))
        check_memory(scenario)  # the verdict is taken from the whole bag
        stoppable(lambda: warm_up(scenario))
        self._run_stack(scenario, environment, watch)
        try:
            record = read_run(self.bag, whole=True)
        except BagError as error:
            if self._interrupted:
                raise RunError("interrupted before anything was recorded") from None
            raise RunError(str(error)) from None
        for warning in record.warnings:
            print(f"warning: {warning}", file=sys.stderr)
        return record

    def judge(self, verdict: Verdict, file: IO[str] | None = None) -> int:
        """Say where the bag is and what it lacks, after all else; return the exit code.

        Raises
        ------
        RunError
            Messages are missing, or the user interrupted.
        """
        print(self.told, file=file)
        record = verdict.record
        if record.missing_messages:
            lost = ", ".join(f"{count} of {name}" for name, count in record.missing.items())
            raise RunError(f"the bag lacks messages: {lost}")
        if self._interrupted:
            raise RunError("interrupted before the end; the bag holds what was run until then")
        return exit_code(verdict)

    def _run_stack(
        self, scenario: Scenario, environment: Mapping[str, str], watch: Watch | None
    ) -> None:
        """Run all processes to the end, or until the user interrupts."""
        print(f"ROS domain {environment[DOMAIN]}, discovery {reach(environment)}", file=sys.stderr)
        duration = scenario.number(PLANT, "duration")
        with stop_on_signals() as stop, _progress(duration) as show:
            stack = Stack(scenario, show, environment=environment)
            finished = False
            try:
                stack.start()
                if watch:
                    watch(lambda: stack.goes_on(stop))
                else:
                    stack.wait(stop)
                stack.stop()
                finished = not stop.is_set()
            except StackError as error:
                # The first failure is the one to report; what stopping finds is its consequence.
                with suppress(StackError):
                    stack.stop()
                if error.refused:
                    raise ConfigurationError(str(error)) from None
                if stack.has_begun or not stop.is_set():
                    where = f"\n{self.told}" if stack.has_begun else ""
                    raise RunError(f"{error}{where}") from None
            finally:
                stack.kill()
                self._interrupted = stop.is_set()
                bag = stack.told().get(RECORDER, {}).get(BAG)
                if bag and not (finished or stack.has_begun):
                    shutil.rmtree(bag, ignore_errors=True)  # it would only be in the next one's way
            if finished:
                show(duration)  # the plant tells the time ten times a second, not at its end


@contextmanager
def _progress(duration: float) -> Iterator[Any]:
    """Progress bar over simulated time; gives the function that moves it."""
    form = "{l_bar}{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}, {rate_fmt}{postfix}]"
    with progress_bar(total=duration, desc="simulated", unit="s", bar_format=form) as bar:
        # The last step may pass the duration by half of one.
        yield lambda t: bar.update(min(t, duration) - bar.n)
