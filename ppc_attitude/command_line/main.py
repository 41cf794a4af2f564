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

# PYTHON_ARGCOMPLETE_OK
"""The command `ppc_attitude`: parser, dispatch, and exit codes for what goes wrong."""

import argparse
import gc
import os
import re
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, NoReturn

from ppc_attitude import __version__
from ppc_attitude.bags.errors import printable
from ppc_attitude.command_line.stopping import asked, end_at_once, interrupt, say_interrupted
from ppc_attitude.processes.child import handle_ending, take_signals
from ppc_attitude.processes.exits import BAD_INPUT, BROKEN, DONE, RunError, is_full
from ppc_attitude.processes.imports import forget_current_folder
from ppc_attitude.processes.streams import give_up_output, prepare_streams

COMMANDS = (
    *("run", "simulate", "analyse", "compare", "sweep", "check", "design", "falsify", "campaign"),
    *("replay", "inject", "goto", "watch", "latency", "recover", "export"),
)
"""In the order of the help."""
_EXAMPLES = """examples:
  ppc_attitude run --config config/paper.yaml
  ppc_attitude run --config config/paper.yaml --config config/sudden_disturbance.yaml
  ppc_attitude analyse bags/2026-01-31_12-00-00 --report report.html
  ppc_attitude check --config config/paper.yaml

exit codes: 0 done, no requirement missed; 1 done, a requirement missed;
            2 bad input or configuration; 3 the run broke
"""


class _Formatter(argparse.HelpFormatter):
    """Wraps descriptions, and leaves examples as they stand."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """Says in one line what is wrong, like every other error of this command.

    It reads a word such as -1e-3 or -inf as a number, like -0.001, and not as an option.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._negative_number_matcher = re.compile(r"-(\.?\d|inf)")

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        self.exit(BAD_INPUT, f"error: {message} (see {self.prog} --help)\n")


def _complete() -> None:
    """Tell the shell how its command line may go on, and end this process."""
    import argcomplete

    name = next(iter(os.environ.get("COMP_LINE", "").split()[1:2]), "")
    parser, commands = parsers((name,) if name in COMMANDS else ())
    for other in COMMANDS if not commands.choices else ():
        commands.add_parser(other)
    argcomplete.autocomplete(parser)


def parsers(names: Sequence[str] = COMMANDS) -> "tuple[Parser, argparse._SubParsersAction[Parser]]":
    """Build the parser of the executable; also return the action with those of its commands."""
    parser = Parser(
        prog="ppc_attitude",
        description="Prescribed-performance attitude control: run, record, judge.",
        epilog=_EXAMPLES,
        formatter_class=_Formatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in names:
        command = import_module(f"ppc_attitude.command_line.commands.{name}")
        own = subparsers.add_parser(
            name,
            help=command.HELP,
            description=command.DESCRIPTION,
            epilog="\n".join(["examples:", *(f"  {line}" for line in command.EXAMPLES)]),
            formatter_class=_Formatter,
        )
        own.set_defaults(execute=command.execute)
        command.add_options(own)
    return parser, subparsers


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "_ARGCOMPLETE" in os.environ:
        _complete()
    named = [word for word in words[:1] if word in COMMANDS]
    try:
        parser, commands = parsers(named or COMMANDS)  # each costs its imports
        for word in words:
            if word != word.encode(errors="replace").decode():  # no page, bag or table can name it
                parser.error(f"argument {printable(word)}; allowed: text in UTF-8")
        parsed, unknown = parser.parse_known_args(words)
        if unknown:  # the help of the command, not of the executable, lists the options
            own = commands.choices[parsed.command]
            own.error(f"unrecognized arguments: {' '.join(unknown)}")
        interrupt()
        if not gc.isenabled():  # collections that walk through all imported objects took 0.2 s
            gc.freeze()
            gc.enable()
        return int(parsed.execute(parsed))
    except RunError as error:
        print(f"error: {error}", file=sys.stderr)
        return BROKEN
    except ValueError as error:
        # Configuration, bag and analysis errors are ValueErrors that name what is wrong.
        print(f"error: {printable(str(error))}", file=sys.stderr)
        return BROKEN if is_full(error.__cause__) else BAD_INPUT
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("ppc_attitude"):
            raise
        name, hint = (error.name or "").partition(".")[0], ""
        if name.startswith("rcl") or name.endswith(("_msgs", "_srvs")):  # whichever came first
            name, hint = "rclpy", ": source ROS 2 Jazzy, or pip install 'ppc_attitude[ros]'"
        print(f"error: this command needs {name}, which is not installed{hint}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        raise
    except OSError as error:
        # What is missing and has no name is the current folder, which somebody has removed.
        name = error.filename or ("." if isinstance(error, FileNotFoundError) else "")
        where = f"{name}: " if name else ""
        print(f"error: {where}{error.strerror or error}", file=sys.stderr)
        return BAD_INPUT if name and not is_full(error) else BROKEN
    except (KeyboardInterrupt, Exception) as error:
        # A compiler that is interrupted fails with an error of its own.
        if not isinstance(error, KeyboardInterrupt) and not asked:
            raise
        print("interrupted", file=sys.stderr)
        return BROKEN


def run() -> None:
    """Run as an executable, quiet when the reader of a pipe has gone."""
    gc.disable()
    end_at_once()
    take_signals()
    forget_current_folder()
    prepare_streams()
    try:
        code = _ended()
        sys.stdout.flush()
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(f"error: {error.strerror}", file=sys.stderr)
        give_up_output()
        code = BROKEN
    except KeyboardInterrupt:  # a second request, while the first was being reported
        say_interrupted()
        code = BROKEN
    handle_ending(signal.SIG_IGN)  # nothing disturbs the end
    # This skips the teardown of all modules, which takes 0.1 s. And Python remembers an interrupt
    # that left an `exec`, as of a dataclass, and would die of SIGINT although it was handled.
    with suppress(OSError):
        sys.stdout.flush()
    os._exit(code)


def _ended() -> int:
    try:
        return main()
    except SystemExit as end:  # argparse has said what there was to say
        return int(end.code or DONE)


if __name__ == "__main__":
    run()
