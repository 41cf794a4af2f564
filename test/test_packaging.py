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

"""The package tells the truth: one version, true dependencies, every shared file installed."""

import runpy
import sys
from importlib import import_module
from typing import Any
from unittest import mock

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import Package, parse_package
from craft_helpers import ROOT
from packaging.requirements import Requirement
from test_layers import PACKAGE, SOURCES, imports_of

import ppc_attitude
from ppc_attitude.contract.topics import MARKERS, OF_A_RUN

# Imported module: its requirement for pip (None: not on PyPI), its rosdep key (None: optional).
DEPENDENCIES: dict[str, tuple[str | None, str | None]] = {
    "argcomplete": ("argcomplete", "python3-argcomplete"),
    "cma": ("cma", None),
    "dask": ("dask", None),
    "diagnostic_msgs": ("ros-jazzy-common-interfaces", "diagnostic_msgs"),
    "distributed": ("dask", None),
    "flint": ("python-flint", None),
    "geometry_msgs": ("ros-jazzy-common-interfaces", "geometry_msgs"),
    "sensor_msgs": ("ros-jazzy-common-interfaces", "sensor_msgs"),
    "launch": (None, "launch"),
    "launch_ros": (None, "launch_ros"),
    "lz4": ("lz4", "python3-rosbags-pip"),
    "matplotlib": ("matplotlib", "python3-matplotlib"),
    "mcap": ("mcap", "mcap-ros2-support"),
    "numba": ("numba", "python3-numba"),
    "numpy": ("numpy", "python3-numpy"),
    "pyarrow": ("pyarrow", None),
    "rcl_interfaces": ("ros-jazzy-rclpy", "rcl_interfaces"),
    "rclpy": ("ros-jazzy-rclpy", "rclpy"),
    "rich": ("rich", "python3-rich"),
    "rosbags": ("rosbags", "python3-rosbags-pip"),
    "ruamel": ("ruamel.yaml.clib", "python3-rosbags-pip"),
    "rosgraph_msgs": ("ros-jazzy-rclpy", "rosgraph_msgs"),
    "scipy": ("scipy", "python3-scipy"),
    "sgp4": ("sgp4", None),
    "std_msgs": ("ros-jazzy-common-interfaces", "std_msgs"),
    "std_srvs": ("ros-jazzy-common-interfaces", "std_srvs"),
    "tf2_ros": (None, "tf2_ros"),
    "tqdm": ("tqdm", "python3-tqdm"),
    "trajectory_msgs": ("ros-jazzy-common-interfaces", "trajectory_msgs"),
    "visualization_msgs": ("ros-jazzy-common-interfaces", "visualization_msgs"),
    "yaml": ("PyYAML", "python3-yaml"),
    "zstandard": ("zstandard", "python3-rosbags-pip"),
}
RUN_TIME_EXTRAS = ("ros", "campaign", "guarantee", "orbit")
# Numba needs SciPy at run time for the linear algebra inside kernels; rosbags writes metadata with
# ruamel.yaml, which is quick with its part in C.
NEEDED_WITHOUT_IMPORT = {"ruamel", "scipy", "sensor_msgs"}


@pytest.fixture(scope="module")
def setup_arguments() -> dict[str, Any]:
    with pytest.MonkeyPatch.context() as patch, mock.patch("setuptools.setup") as setup:
        patch.chdir(ROOT)
        runpy.run_path("setup.py")
    return dict(setup.call_args.kwargs)


@pytest.fixture(scope="module")
def manifest() -> Package:
    return parse_package(str(ROOT / "package.xml"))


@pytest.fixture(scope="module")
def imported_modules() -> set[str]:
    files = [*SOURCES, *(ROOT / "launch").rglob("*.py")]
    tops = {name.partition(".")[0] for path in files for name in imports_of(path)}
    return {top for top in tops if top not in sys.stdlib_module_names} - {PACKAGE}


def names(requirements: list[str]) -> set[str]:
    return {Requirement(each).name for each in requirements}


def test_one_version_everywhere(setup_arguments: dict[str, Any], manifest: Package) -> None:
    assert setup_arguments["version"] == ppc_attitude.__version__
    assert manifest.version == ppc_attitude.__version__


def test_changelog_knows_the_version(manifest: Package) -> None:
    changelog = get_changelog_from_path(str(ROOT / "CHANGELOG.rst"), manifest.name)
    versions = [version for version, _, _ in changelog.foreach_version()]
    assert manifest.version in versions
    assert all(changelog.get_content_of_version(version) for version in versions)


def test_manifest_is_valid(setup_arguments: dict[str, Any], manifest: Package) -> None:
    warnings: list[str] = []
    manifest.validate(warnings=warnings)
    assert not warnings
    assert manifest.name == setup_arguments["name"] == PACKAGE
    assert manifest.get_build_type() == "ament_python"
    assert manifest.package_format == 3
    assert [str(license_) for license_ in manifest.licenses] == [setup_arguments["license"]]
    assert manifest.maintainers[0].email == setup_arguments["maintainer_email"]
    assert (ROOT / manifest.licenses[0].file).is_file()


def test_every_import_is_declared_for_pip(
    setup_arguments: dict[str, Any], imported_modules: set[str]
) -> None:
    assert imported_modules <= DEPENDENCIES.keys()
    extras = [setup_arguments["extras_require"][extra] for extra in RUN_TIME_EXTRAS]
    declared = names(sum(extras, setup_arguments["install_requires"]))
    needed = {DEPENDENCIES[module][0] for module in imported_modules} - {None}
    assert needed <= declared


def test_every_import_is_declared_for_rosdep(manifest: Package, imported_modules: set[str]) -> None:
    declared = {dependency.name for dependency in manifest.exec_depends}
    assert {DEPENDENCIES[module][1] for module in imported_modules} - {None} <= declared


def test_nothing_is_declared_that_nothing_needs(
    setup_arguments: dict[str, Any], manifest: Package, imported_modules: set[str]
) -> None:
    needed = imported_modules | NEEDED_WITHOUT_IMPORT
    requirements, keys = (set(c) for c in zip(*map(DEPENDENCIES.__getitem__, needed), strict=True))
    assert names(setup_arguments["install_requires"]) <= requirements
    assert {dependency.name for dependency in manifest.exec_depends} <= keys


def test_entry_points_lead_to_a_main(setup_arguments: dict[str, Any]) -> None:
    scripts = dict(line.split(" = ") for line in setup_arguments["entry_points"]["console_scripts"])
    assert scripts.keys() == {*OF_A_RUN, MARKERS, PACKAGE}
    for target in scripts.values():
        module, _, function = target.partition(":")
        assert callable(getattr(import_module(module), function)), target
