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

"""A host with a network interface of its own: a namespace in which nodes can be started.

Run as `unshare --net --map-root-user python host.py SOCKET ADDRESS`. The other end of its cable is
a file descriptor, which goes to whoever listens at the socket; every frame is one read or write.
"""

import fcntl
import os
import socket
import struct
import subprocess
import sys

_DEVICE = "/dev/net/tun"
_SET_INTERFACE, _FRAMES, _NO_HEADER = 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h


def main(listener: str, address: str) -> None:
    """Bring up the interface, hand over its cable, and stay until standard input ends."""
    cable = os.open(_DEVICE, os.O_RDWR)
    fcntl.ioctl(cable, _SET_INTERFACE, struct.pack("16sH", b"cable", _FRAMES | _NO_HEADER))
    for words in (
        "link set lo up",
        f"address add {address}/24 dev cable",
        "link set cable up",
    ):
        subprocess.run(["ip", *words.split()], check=True)
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(listener)
        socket.send_fds(connection, [b"cable"], [cable])
    sys.stdin.read()


if __name__ == "__main__":
    main(*sys.argv[1:])
