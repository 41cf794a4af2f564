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

"""`python -m bench`: measure, print tables, write build/bench.json."""

import argparse
import json
import os
from contextlib import suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from bench.table import tables
from ppc_attitude.contract.versions import versions

NAMES = (
    "lockstep",
    "latency",
    "in_process",
    "campaign",
    "bag_reading",
    "start_up",
    "scaling",
)
OUTPUT = Path("build/bench.json")


def machine() -> dict[str, Any]:
    """On what is measured."""
    found = dict(versions())
    with suppress(PackageNotFoundError):
        found["bsk"] = version("bsk")
    return {"cores": os.cpu_count(), "load": os.getloadavg()[0], "versions": found}


def main(arguments: list[str] | None = None) -> None:
    """Measure what is asked for; what is not keeps its figures."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--only", choices=NAMES, action="append", help="measure only this")
    parser.add_argument("--quick", action="store_true", help="short runs: see that it works")
    parser.add_argument("--output", type=Path, default=OUTPUT, metavar="FILE")
    options = parser.parse_args(arguments)
    results: dict[str, Any] = {}
    if options.only and options.output.exists():
        results = json.loads(options.output.read_text(encoding="utf-8"))
    results["machine"] = machine()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    for name in options.only or NAMES:
        measure = import_module(f"bench.{name}").measure
        results[name] = measure(options.quick)
        print(f"{tables({name: results[name]})}\n", flush=True)
        options.output.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    print(f"{tables(results)}\n\nwritten: {options.output}")


if __name__ == "__main__":
    main()
