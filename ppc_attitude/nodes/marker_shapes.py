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

"""The shapes that stand for a run: a box, the axes of frames, arrows, and keep-out cones.

Positions [m] are in inertial axes; attitudes are quaternions x y z w, from a frame to inertial.
"""

import math
from itertools import pairwise

from geometry_msgs.msg import Point, Quaternion, TransformStamped, Vector3
from rclpy.time import Time
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from ppc_attitude.science import kernel
from ppc_attitude.science.attitude import rotate
from ppc_attitude.science.component import INERTIAL
from ppc_attitude.science.keep_out import perpendicular

LONGEST = 2.0  # [m] of an arrow, whatever the torque
CONE_LENGTH = 2.0  # [m]
_FACETS = 36
_SHORTEST = 1e-3  # [m] shorter arrows are taken away: a viewer cannot draw them
_BOX = (0.7, 0.6, 0.5)  # [m] longest along the axis of least inertia in the paper's craft
_AXES = (
    ((1.0, 0.0, 0.0), (0.90, 0.20, 0.20)),
    ((0.0, 1.0, 0.0), (0.20, 0.75, 0.25)),
    ((0.0, 0.0, 1.0), (0.25, 0.40, 0.95)),
)


def header(stamp_ns: int) -> Header:
    """Header for every shape: all of them stand in the inertial frame."""
    return Header(stamp=Time(nanoseconds=stamp_ns).to_msg(), frame_id=INERTIAL)


def box(position: kernel.Vector, attitude: kernel.Quaternion) -> Marker:
    """Return the craft."""
    marker = _marker("craft", 0, Marker.CUBE, (0.75, 0.75, 0.80), 0.6)
    marker.pose.position = _point(position)
    marker.pose.orientation = _quaternion(attitude)
    marker.scale = Vector3(x=_BOX[0], y=_BOX[1], z=_BOX[2])
    return marker


def axes(
    name: str, position: kernel.Vector, attitude: kernel.Quaternion, length: float, alpha: float
) -> list[Marker]:
    """Return the three axes of a frame, x y z in red, green and blue."""
    return [
        arrow(
            (name, number),
            position,
            kernel.scale(length, rotate(attitude, axis)),
            (colour, alpha, 0.02),
        )
        for number, (axis, colour) in enumerate(_AXES)
    ]


def arrow(
    identity: tuple[str, int],
    start: kernel.Vector,
    extent: kernel.Vector,
    look: tuple[tuple[float, float, float], float, float],
) -> Marker:
    """Return an arrow that begins at a place and goes so far [m], in inertial axes.

    Its identity is namespace and number of the marker, its look colour (red, green, blue), opacity
    and shaft diameter [m].
    """
    colour, alpha, diameter = look
    marker = _marker(*identity, Marker.ARROW, colour, alpha)
    length = math.sqrt(kernel.dot(extent, extent))
    if length < _SHORTEST:
        marker.action = Marker.DELETE
        return marker
    shown = kernel.scale(min(1.0, LONGEST / length), extent)
    marker.points = [_point(start), _point(kernel.add(start, shown))]
    marker.scale = Vector3(x=diameter, y=2.5 * diameter, z=4.0 * diameter)
    return marker


def cone(
    number: int,
    apex: kernel.Vector,
    direction: kernel.Vector,
    half_angle: float,
    colour: tuple[float, float, float],
) -> Marker:
    """Return the mantle of a cone of slant length `CONE_LENGTH`.

    The tip is at the apex [m], the axis along the unit vector `direction`, both in inertial axes.
    With a half angle [rad] above π/2 it opens backwards.
    """
    marker = _marker("keep_out", number, Marker.TRIANGLE_LIST, colour, 0.25)
    marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
    centre = kernel.scale(math.cos(half_angle), direction)
    u = perpendicular(direction)
    v = kernel.cross(direction, u)
    rim = []
    for k in range(_FACETS + 1):
        turn = math.tau * k / _FACETS
        across = kernel.add(kernel.scale(math.cos(turn), u), kernel.scale(math.sin(turn), v))
        edge = kernel.add(centre, kernel.scale(math.sin(half_angle), across))
        rim.append(_point(kernel.add(apex, kernel.scale(CONE_LENGTH, edge))))
    for left, right in pairwise(rim):
        marker.points += [_point(apex), left, right]
    return marker


def transform(child: str, position: kernel.Vector, attitude: kernel.Quaternion) -> TransformStamped:
    """Return the place of a frame in the inertial frame."""
    result = TransformStamped(child_frame_id=child)
    result.transform.translation = Vector3(x=position[0], y=position[1], z=position[2])
    result.transform.rotation = _quaternion(attitude)
    return result


def _marker(
    name: str, number: int, kind: int, colour: tuple[float, float, float], alpha: float
) -> Marker:
    red, green, blue = colour
    marker = Marker(ns=name, id=number, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    return marker


def _point(a: kernel.Vector) -> Point:
    return Point(x=a[0], y=a[1], z=a[2])


def _quaternion(q: kernel.Quaternion) -> Quaternion:
    return Quaternion(x=q[0], y=q[1], z=q[2], w=q[3])
