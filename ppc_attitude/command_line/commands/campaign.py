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

"""`ppc_attitude campaign`: Monte Carlo over what a YAML declares, on all cores or a cluster."""

import argparse
import sys
import time
from dataclasses import replace
from datetime import datetime

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.campaign.campaign import Finished, run_campaign
from ppc_attitude.campaign.declaration import Campaign, draw, load_campaign, scenario_of_run
from ppc_attitude.campaign.pools import cores
from ppc_attitude.campaign.rows import CampaignError, rerun
from ppc_attitude.campaign.variables import varying
from ppc_attitude.campaign.varied import idle
from ppc_attitude.command_line.in_process import check_memory, tell_concerns
from ppc_attitude.command_line.options import (
    add_bag_option,
    add_judging_options,
    add_scenario_options,
    exit_code,
    number,
    print_json,
    print_verdict,
    requirements_of,
    scenario_of,
    see_that_none_is_idle,
    write_report_of,
)
from ppc_attitude.command_line.paths import new_folder, shipped_config, some_path
from ppc_attitude.command_line.progress import progress_bar
from ppc_attitude.command_line.recording import Recording
from ppc_attitude.command_line.stopping import stop_on_signals, stoppable
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.contract.whole_file import dated
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED, RunError
from ppc_attitude.science.kinds import SENSORS
from ppc_attitude.simulation.closed_loop import warm_up

HELP = "Monte Carlo: many drawn runs, in process, judged together"
DESCRIPTION = (
    "Draws each run from the distributions in --campaign, simulates it and judges it. A run "
    "depends on seed and index alone, so --only repeats it."
)
EXAMPLES = (
    "ppc_attitude campaign --campaign config/campaign.yaml --runs 1000 --seed 1",
    "ppc_attitude campaign --campaign config/campaign.yaml --only 17",
)
RUNS = 1000


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    parser.add_argument(
        "--campaign",
        metavar="FILE",
        type=some_path,
        help="what varies; default config/campaign.yaml",
    )
    at_least_one, from_zero = number(1, 1e9, whole=True), number(0, whole=True)
    told = f"number of runs; default {RUNS}"
    parser.add_argument("--runs", metavar="N", type=at_least_one, help=told)
    told = "seed of all draws; default 0"
    parser.add_argument("--seed", metavar="S", type=from_zero, default=0, help=told)
    parser.add_argument(
        "--workers",
        metavar="N",
        type=at_least_one,
        help="processes on this machine; default one for each core",
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="run on the Dask cluster of the scheduler there"
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=new_folder,
        help="folder of the results; default a new, dated one",
    )
    parser.add_argument("--only", metavar="INDEX", type=from_zero, help="repeat this run alone")
    parser.add_argument(
        "--record", action="store_true", help="with --only: run it through the nodes, and record it"
    )
    add_bag_option(parser, "with --only: record as with --record, in this folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_judging_options(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the campaign, or one run of it."""
    alone = arguments.only is not None
    see_that_none_is_idle(arguments, alone, "one run: --only INDEX", "record", "bag")
    several = "several runs, without --only"
    see_that_none_is_idle(arguments, not alone, several, "runs", "workers", "scheduler", "out")
    here = "processes of this machine, without --scheduler"
    see_that_none_is_idle(arguments, not arguments.scheduler, here, "workers")
    runs = RUNS if arguments.runs is None else arguments.runs
    file = arguments.campaign or shipped_config("campaign.yaml")
    campaign = replace(
        load_campaign(file, scenario_of(arguments), arguments.seed),
        required=requirements_of(arguments),
    )
    if unknown := idle(campaign.declaration, campaign.scenario):
        sensors = campaign.scenario.parameters[PLANT][SENSORS.selector]
        told = f"not drawn: {', '.join(unknown)}; sensors = {sensors} has no such parameter"
        print(told, file=sys.stderr)
    if not arguments.scheduler:  # the runs of a cluster take the memory of others
        check_memory(campaign.scenario, 1 if alone else min(arguments.workers or cores(), runs))
        stoppable(lambda: warm_up(campaign.scenario))
    if alone:
        return _execute_one(arguments, campaign)
    start = time.monotonic()
    with progress_bar(total=runs, desc="campaign", unit=" runs") as bar:
        try:
            finished = run_campaign(
                campaign,
                runs,
                arguments.out or dated("campaigns"),
                workers=arguments.workers,
                scheduler=arguments.scheduler,
                progress=lambda done: bar.update(done - bar.n),
                stopping=stop_on_signals,
            )
        except CampaignError as error:
            raise RunError(str(error)) from None
    _tell(campaign, finished, time.monotonic() - start, as_json=arguments.json)
    if arguments.report:
        from ppc_attitude.campaign.report import write_campaign_report

        title, now = arguments.mission, f"{datetime.now():%Y-%m-%d %H:%M}"
        again = _again(arguments)
        write_campaign_report(campaign, finished, again, arguments.report, mission=title, date=now)
        print(f"report: {arguments.report}", file=sys.stderr)
    return _exit_code(finished)


def _execute_one(arguments: argparse.Namespace, campaign: Campaign) -> int:
    """Run one index again, in process or through the nodes, and judge it as any run."""
    if not (arguments.record or arguments.bag):
        verdict = stoppable(lambda: rerun(campaign, arguments.only))
        tell_concerns(scenario_of_run(campaign, arguments.only), verdict.record)
        _tell_one(arguments, campaign, verdict)
        return exit_code(verdict)
    recording = Recording(arguments.bag)
    record = recording.run(scenario_of_run(campaign, arguments.only))
    verdict = Verdict(record, campaign.required)
    _tell_one(arguments, campaign, verdict)
    return recording.judge(verdict, sys.stderr if arguments.json else sys.stdout)


def _tell_one(arguments: argparse.Namespace, campaign: Campaign, verdict: Verdict) -> None:
    drawn, names = draw(campaign, arguments.only), varying(campaign.variables)
    print_verdict(verdict, as_json=arguments.json, drawn=drawn)
    if not arguments.json:
        print("drawn: " + ", ".join(f"{n} {v:.6g}" for n in names if (v := drawn[n]) is not None))
    write_report_of(arguments, [verdict], sys.stderr)


def _tell(campaign: Campaign, finished: Finished, seconds: float, *, as_json: bool) -> None:
    summary = finished.summary
    if as_json:
        print_json(
            {
                "campaign": str(finished.folder),
                "controller": campaign.scenario.controller.name,
                "seed": campaign.seed,
                "runs": finished.total,
                "done": summary.runs,
                "runs_per_s": summary.runs / seconds,
                **summary.to_json(),
            }
        )
        return
    rows = [(name, str(tally.fraction)) for name, tally in summary.requirements()]
    rows += [(name, str(fraction)) for name, fraction in summary.shares()]
    width = max(len(name) for name, _ in rows)
    print(
        f"{summary.runs} runs of {campaign.duration:g} s in {seconds:.1f} s, seed {campaign.seed}"
    )
    for name, share in rows:
        print(f"{name:<{width}}  {share}")
    for name, tally in summary.requirements():
        if tally.met < tally.judged:
            indices = ", ".join(str(index) for index, _ in tally.worst_runs())
            print(f"worst runs of {name}, which --only INDEX repeats: {indices}")
    print(f"campaign: {finished.folder}")


def _exit_code(finished: Finished) -> int:
    """Exit code of a campaign; RunError if it was interrupted, or some run broke."""
    summary = finished.summary
    if summary.runs < finished.total:
        raise RunError(
            f"interrupted after {summary.runs} of {finished.total} runs; "
            f"{finished.folder} holds them"
        )
    if summary.first_broken is not None:
        index, reason = summary.first_broken
        raise RunError(f"{summary.broken} runs broke; the first, run {index}: {reason}")
    return DONE if summary.all_met == summary.runs else REQUIREMENT_FAILED


def _again(arguments: argparse.Namespace) -> list[str]:
    """Command line of this campaign, to which --only is appended."""
    words = ["ppc_attitude", "campaign"]
    for option in ("config", "requirements", "duration", "controller", "campaign", "seed"):
        given = getattr(arguments, option)
        values = given if isinstance(given, list) else [given]
        words += [f"--{option}={value}" for value in values if value is not None]
    return words
