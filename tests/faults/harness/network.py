"""A network of its own that a test makes, with one link to this machine that can be cut. It needs root and `ip`."""

import os
import shutil
import subprocess
from typing import Self

IS_POSSIBLE = os.geteuid() == 0 and shutil.which("ip") is not None
REASON = "needs root and ip (Debian: apt-get install iproute2) for a network namespace"


class Network:
    """A network namespace. `own` is the address of this machine on the link, `other` that of the namespace.

    Parameters
    ----------
    number
        From 0 to 255; networks at one time have different ones.
    """

    def __init__(self, number: int) -> None:
        self.own, self.other = f"10.99.{number}.1", f"10.99.{number}.2"
        self._name, self._link = f"headway-cut-{number}", f"hw-cut-{number}"
        self.inside = ("ip", "netns", "exec", self._name)
        """Runs what follows in the network."""
        self.close()  # what a run that was killed has left
        for command in (
            f"ip netns add {self._name}",
            f"ip link add {self._link} type veth peer name eth0 netns {self._name}",
            f"ip addr add {self.own}/30 dev {self._link}",
            f"ip link set {self._link} up",
            f"{' '.join(self.inside)} ip addr add {self.other}/30 dev eth0",
            f"{' '.join(self.inside)} ip link set eth0 up",
            f"{' '.join(self.inside)} ip link set lo up",
            f"{' '.join(self.inside)} ip route add default via {self.own}",
        ):
            subprocess.run(command.split(), check=True)

    def cut(self) -> None:
        """Take the link away."""
        subprocess.run(["ip", "link", "set", self._link, "down"], check=True)

    def join(self) -> None:
        """Bring the link back."""
        subprocess.run(["ip", "link", "set", self._link, "up"], check=True)

    def close(self) -> None:
        """Remove its link and its name; the rest goes with the last process and connection inside."""
        for command in (f"ip link del {self._link}", f"ip netns del {self._name}"):
            subprocess.run(command.split(), check=False, stderr=subprocess.DEVNULL)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
