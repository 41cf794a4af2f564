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

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.errors import RunError
from ppc_attitude.command_line.stack import Stack, StackError, private_environment
from ppc_attitude.command_line.stopping import nothing_begun, stop_on_signals
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import PLANT, RECORDER
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import Scenario


class Recording:
    """A run through the nodes, and its bag.

    Parameters
    ----------
    bag : Path or None
        Folder of the bag; default a new, dated one.

    Raises
    ------
    ConfigurationError
        The folder exists.
    """

    def __init__(self, bag: Path | None) -> None:
        self.bag = bag or Path("bags") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{os.getpid()}"
        if self.bag.exists():
            raise ConfigurationError(f"bag folder {self.bag} exists already and is not overwritten")
        if bag is None:
            self.bag = self.bag.absolute()
        self._interrupted = False

    def run(self, scenario: Scenario, lockstep: bool = True) -> RunRecord:
        """Run a scenario and read what was recorded.

        Raises
        ------
        RunError
            The run broke, or its bag cannot be read.
        """
        scenario = scenario.awaiting_recorder().with_values(PLANT, lockstep=lockstep)
        scenario = scenario.with_values(RECORDER, bag=str(self.bag))
        with nothing_begun():
            warm_up(scenario)
        self._interrupted = _run_stack(scenario, self.bag)
        try:
            record = read_run(self.bag)
        except BagError as error:
            if self._interrupted:
                raise RunError("interrupted before anything was recorded") from None
            raise RunError(str(error)) from None
        for warning in record.warnings:
            print(f"warning: {warning}", file=sys.stderr)
        return record

    def complain(self, record: RunRecord) -> None:
        """Say what the bag lacks, when everything else has been said.

        Raises
        ------
        RunError
            Messages are missing, or the user interrupted.
        """
        if record.missing_messages:
            lost = ", ".join(f"{count} of {name}" for name, count in record.missing.items())
            raise RunError(f"the bag lacks messages: {lost}")
        if self._interrupted:
            raise RunError("interrupted before the end; the bag holds what was run until then")


def _run_stack(scenario: Scenario, bag: Path) -> bool:
    """Run all processes to the end; True if the user interrupted."""
    environment = private_environment()
    print(
        f"ROS domain {environment['ROS_DOMAIN_ID']}, "
        f"discovery {environment['ROS_AUTOMATIC_DISCOVERY_RANGE'].lower()}",
        file=sys.stderr,
    )
    duration = scenario.number(PLANT, "duration")
    with (
        stop_on_signals() as stop,
        tempfile.TemporaryDirectory(prefix="ppc_attitude_") as folder,
        _progress(duration) as show,
    ):
        stack = Stack.of(scenario, Path(folder), show, environment=environment)
        try:
            stack.start()
            stack.wait(stop)
        except StackError as error:
            _end_after_failure(stack)
            raise RunError(f"{error}\nbag: {bag}" if bag.exists() else str(error)) from None
        try:
            stack.stop()
        except StackError as error:
            if stop.is_set() and not stack.has_begun:
                return True
            raise RunError(f"{error}\nbag: {bag}") from None
        if not stop.is_set():
            show(duration)  # the plant tells the time ten times a second, not at its end
        return stop.is_set()


def _end_after_failure(stack: Stack) -> None:
    # The first failure is the one to report; what stopping finds is its consequence.
    try:
        stack.stop()
    except StackError:
        return


@contextmanager
def _progress(duration: float) -> Iterator[Any]:
    """Progress bar over simulated time; gives the function that moves it."""
    form = "{l_bar}{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}, {rate_fmt}{postfix}]"
    with tqdm(
        total=duration, desc="simulated", unit="s", bar_format=form, file=sys.stderr, leave=True
    ) as bar:
        yield lambda t: bar.update(max(t - bar.n, 0.0))
