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

import errno
import os
import re
import shutil
import sys
from collections import namedtuple
from enum import Enum
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from process_helpers import COMMAND, ran

from ppc_attitude.processes.imports import drop_empty_entries
from ppc_attitude.science import kernel
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import CacheFile, Matrix, Vector
from ppc_attitude.science.kinds import all_components
from ppc_attitude.science.part import entry_point
from ppc_attitude.science.referred import digest_of

PACKAGE = Path(kernel.__file__).parent.parent

number = st.floats(-1e3, 1e3)
vectors = st.tuples(number, number, number)
matrices = st.tuples(vectors, vectors, vectors)


@given(vectors, vectors, matrices, st.floats(-10.0, 10.0))
def test_vectors_are_numpys(a: Vector, b: Vector, m: Matrix, s: float) -> None:
    x, y = np.array(a), np.array(b)
    assert np.array_equal(kernel.add(a, b), x + y)
    assert np.array_equal(kernel.subtract(a, b), x - y)
    assert np.array_equal(kernel.scale(s, a), s * x)
    assert np.array_equal(kernel.multiply(a, b), x * y)
    with np.errstate(all="ignore"):
        assert np.array_equal(kernel.divide(a, b), x / y, equal_nan=True)
    assert np.allclose(kernel.cross(a, b), np.cross(x, y), atol=1e-9)
    assert np.isclose(kernel.dot(a, b), x @ y, rtol=1e-12, atol=1e-9)
    assert np.isclose(kernel.norm(a), np.linalg.norm(x), rtol=1e-14)
    assert kernel.largest(a) == np.abs(x).max()
    assert np.allclose(kernel.apply(m, a), np.array(m) @ x, rtol=1e-12, atol=1e-9)
    assert np.array_equal(kernel.clamp(a, 5.0), np.clip(x, -5.0, 5.0))
    assert np.array_equal(kernel.matrix(np.array(m)), m)


def test_processes_that_save_at_once_get_no_code_of_each_other(tmp_path: Path) -> None:
    """The other one reads the index before this one writes it, and saves its code before it."""
    this, other = (kernel.CacheFile(str(tmp_path), "step", 1.0) for _ in "12")
    write = this._save_index

    def meanwhile(entries: dict[str, str]) -> None:
        def in_turn(others: dict[str, str]) -> None:
            write(entries)
            write(others)

        other._save_index = in_turn
        other.save("other", "code of the other")

    this._save_index = meanwhile
    this.save("this", "code of this")
    assert other.load("other") == "code of the other"
    assert this.load("this") is None  # it is compiled again
    this._save_index = write
    this.save("this", "code of this")
    assert (this.load("this"), this.load("other")) == ("code of this", "code of the other")


def test_functions_of_others_are_cached_where_they_belong(tmp_path: Path) -> None:
    """Also by a thread that compiles while another one opens a cache of ours."""
    (tmp_path / "others.py").write_text("def function():\n    return 1.0\n")
    code = (
        "import os, others, numba\n"
        "from concurrent.futures import ThreadPoolExecutor\n"
        "from ppc_attitude.science.attitude import product as ours\n"
        "from ppc_attitude.science.kernel import Cache\n"
        "place = lambda _: numba.njit(cache=True)(others.function)._cache.cache_path\n"
        "with ThreadPoolExecutor(1) as threads:\n"
        "    told = threads.map(place, range(300))\n"
        "    for _ in range(100):\n"
        "        Cache(ours.py_func, ours.__module__)\n"
        "print(*map(os.path.abspath, set(told)), sep='\\n')\n"
    )
    search = os.pathsep.join([str(tmp_path), str(PACKAGE.parent)])
    told = printed(code, tmp_path, PYTHONPATH=search, NUMBA_CACHE_DIR="")
    assert told == f"{tmp_path / '__pycache__'}\n"


def printed(code: str, folder: Path, **environment: str) -> str:
    return ran([sys.executable, "-c", code], env=environment, cwd=folder).stdout


# Executes code once for each text of a file, in copies of a process that has loaded a compiler.
ANEW = """
import os, sys
from pathlib import Path
import numba
numba.njit(lambda: 1.0)()
code, file, *texts = sys.argv[1:]
for text in texts:
    Path(file).write_text(text, encoding="utf-8")
    if (copy := os.fork()) == 0:
        exec(code)
        sys.exit(print(end="|"))
    os.waitpid(copy, 0)
"""


def printed_of(code: str, file: Path, *texts: str, folder: Path, **environment: str) -> list[str]:
    command = [sys.executable, "-c", ANEW, code, str(file), *texts]
    return ran(command, env=environment, cwd=folder).stdout.split("|")[:-1]


@pytest.mark.parametrize(
    ("file", "old", "new", "code"),
    [
        (
            "science/kernel.py",
            "return (s * a[0], s * a[1], s * a[2])",
            "return (2 * s * a[0], s * a[1], s * a[2])",
            "from ppc_attitude.science.attitude import jacobian\n"
            "print(jacobian((0.0, 0.0, 0.0), 1.0, (1.0, 0.0, 0.0)))",
        ),
        pytest.param(
            "science/stamps.py",
            "return stamp_ns * 1e-9",
            "return stamp_ns * 2.5e-9",
            "from ppc_attitude.simulation.closed_loop import stamps_of, timetable_of\n"
            "from ppc_attitude.simulation.scenario import scenario\n"
            "print(timetable_of(scenario({}), stamps_of(1.0, 1.0)))",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_kernel_is_compiled_anew_when_what_it_calls_has_changed(
    tmp_path: Path, file: str, old: str, new: str, code: str
) -> None:
    """Numba itself looks only at the kernel's own file, and would run old machine code.

    Nor does it look at more where it keeps that for the user, because the package is read-only.
    """
    copy = tmp_path / "ppc_attitude"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "science" / "__pycache__").write_text("a folder cannot be made here, not even by root")
    places = {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "home")}
    source = (copy / file).read_text(encoding="utf-8")
    assert source.count(old) == 1
    texts = source, source.replace(old, new)
    before, after = printed_of(code, copy / file, *texts, folder=tmp_path, **places)
    assert before != after


def refers(**changed: Any) -> Any:
    """Make a function that refers to this and that, some of it other than usual."""
    given = {"gain": 1.0, "factor": 2.0, "row": (3.0, 4.0), "table": 5.0, "kernel": 6.0}
    given = {**given, "mode": 8.0, "layout": 0, "pair": "a b", "ufunc": 1.0, **changed}
    library, inner = ModuleType("library"), ModuleType("library.inner")
    vars(library).update(gain=given["gain"], inner=inner)
    vars(inner)["depth"] = given.get("depth", 7.0)
    called = numba.njit(lambda number=given["kernel"]: number)
    slope = given["ufunc"]
    ufunc = numba.vectorize(lambda x: x * slope)
    mode, pair = Enum("Mode", {"A": given["mode"]}), namedtuple("Pair", given["pair"])(1.0, 2.0)
    layout = np.dtype({"names": ["a"], "formats": ["f8"], "offsets": [given["layout"]]})
    sums = f"sum(x * {given['factor']} for x in row)"
    names = {"row": given["row"], "table": np.array([given["table"]])}
    known = {"library": library, "called": called, "ufunc": ufunc, "mode": mode, **names}
    known |= {"layout": layout, "pair": pair}
    sums += " + library.gain + library.inner.depth + table + ufunc(mode.A.value) + layout + pair.a"
    exec(f"def function(a=1):\n    return called() + {sums}", known)
    return known["function"]


@pytest.mark.parametrize(
    "name",
    ["gain", "depth", "factor", "row", "table", "kernel", "mode", "layout", "pair", "ufunc"],
)
def test_a_function_is_another_one_when_what_it_refers_to_has_changed(name: str) -> None:
    assert digest_of(refers()) == digest_of(refers())
    changed = {"row": (3.0, 9.0), "pair": "b a", "layout": 8}.get(name, 9.0)
    assert digest_of(refers(**{name: changed})) != digest_of(refers())


def test_a_function_is_another_one_when_the_file_of_a_class_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba makes code of it in ways that nobody can list."""
    monkeypatch.syspath_prepend(tmp_path)
    digests = set()
    for name in ("one", "other", "as_one"):
        (tmp_path / f"{name}.py").write_text(f"class Made:\n    number = {len(name) % 2}\n")
        known = {"made": import_module(name).Made}
        exec("def function():\n    return made.number", known)
        digests.add(digest_of(known["function"]))
    assert len(digests) == 2


@pytest.mark.parametrize(
    ("package", "of_called"),
    [
        pytest.param("", "", marks=pytest.mark.long),
        pytest.param("namespace.", "namespace.", marks=pytest.mark.long),
        ("namespace.", "other."),
    ],
)
def test_a_kernel_of_somebody_elses_is_compiled_anew_when_what_it_calls_has_changed(
    tmp_path: Path, package: str, of_called: str
) -> None:
    """A module that lies alone has no package, and a namespace package no file."""
    for each in (package, of_called):
        (tmp_path / each.rstrip(".")).mkdir(exist_ok=True)
    folder = tmp_path / package.rstrip(".")
    (folder / "absent.py").symlink_to("nowhere")
    kernels = "from ppc_attitude.science.kernel import kernel\n@kernel\ndef {}():\n    return {}\n"
    called = tmp_path / of_called.rstrip(".") / "called.py"
    # Python takes a file of the same second and length for unchanged.
    texts = [kernels.format("called", number) for number in (1.0, 12.0)]
    (folder / "calling.py").write_text(
        f"from {of_called}called import called\n{kernels.format('calling', 'called()')}"
    )
    search = os.pathsep.join([str(tmp_path), str(PACKAGE.parent)])
    environment = {"PYTHONPATH": search, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    code = f"from {package}calling import calling; print(calling())"
    assert printed_of(code, called, *texts, folder=tmp_path, **environment) == ["1.0\n", "12.0\n"]


_COMMAND = (
    "import sys; from ppc_attitude.command_line.main import main; sys.exit(main(['simulate']))"
)
_NODE = (
    "import sys; from ppc_attitude.nodes.executables import ppc_controller as run; sys.exit(run())"
)


def test_machine_code_is_loaded_without_what_numba_compiles_with(tmp_path: Path) -> None:
    """Nor what looks for a BLAS and imports SciPy. LLVM would abort where a symbol lacks."""
    for component in all_components():
        entry_point(component)
    code = (
        "import sys\n"
        "from ppc_attitude.science.kinds import all_components\n"
        "from ppc_attitude.science.part import entry_point\n"
        "print(all(entry_point(each).address for each in all_components()))\n"
        "print('numba.np.linalg' in sys.modules)\n"
    )
    assert printed(code, tmp_path, PYTHONPATH=str(PACKAGE.parent)) == "True\nFalse\n"


@pytest.mark.parametrize("code", [_COMMAND, pytest.param(_NODE, marks=pytest.mark.ros)])
def test_kernels_that_have_no_place_are_refused_with_the_way_out(tmp_path: Path, code: str) -> None:
    """A package that is installed read-only, and a user without a home."""
    copy, blocked = tmp_path / PACKAGE.name, tmp_path / "blocked"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for each in (blocked, copy / "science" / "__pycache__"):
        each.write_text("a folder cannot be made here, not even by root")
    homes = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"), str(blocked))
    search = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    environment = {**homes, "PYTHONPATH": search}
    told = ran([sys.executable, "-c", code], 2, env=environment, cwd=tmp_path).stderr
    assert f"compiled kernels cannot be saved: neither {blocked}" in told
    assert told.endswith("set NUMBA_CACHE_DIR to one that can\n")


@pytest.mark.parametrize("ending", ["nbi", "nbc"])  # of the index, and of the machine code
@pytest.mark.parametrize("content", [b"", b"garbage", b"\x80\x05half"])
def test_what_is_damaged_in_the_cache_is_compiled_again(
    tmp_path: Path, ending: str, content: bytes
) -> None:
    kept = CacheFile(str(tmp_path), "step", source_stamp=0)
    for _ in range(2):
        kept.save("key", b"machine code")
        assert kept.load("key") == b"machine code"
        next(tmp_path.glob(f"*.{ending}")).write_bytes(content)
        assert kept.load("key") is None


def test_machine_code_is_not_kept_in_the_current_folder_because_the_users_is_named_empty() -> None:
    environment = {"XDG_CACHE_HOME": "", "PATH": "/bin:"}
    drop_empty_entries(environment)
    assert environment == {"PATH": "/bin"}


def test_a_full_cache_is_told_with_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(CacheFile, "_save_data", fill)
    told = f"saved in {re.escape(str(tmp_path))}: No space left on device; set NUMBA_CACHE_DIR"
    with pytest.raises(ConfigurationError, match=told):
        CacheFile(str(tmp_path), "step", source_stamp=0).save("key", b"machine code")


def test_a_numba_that_compiles_nothing_is_told_with_its_setting() -> None:
    told = ran([*COMMAND, "check"], 2, env={"NUMBA_DISABLE_JIT": "1"}).stderr
    assert "allowed: a kernel, and no NUMBA_DISABLE_JIT in the environment" in told
