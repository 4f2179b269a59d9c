"""Two hosts on one machine: network namespaces with a virtual cable that drops packets on demand."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from panoptic_ros.errors import EnvironmentProblem

# a private /dev/shm, because shared memory would connect the hosts
ALONE = 'mount -t tmpfs -o size=256m none /dev/shm && exec "$@"'
TABLE = (  # filter at the device, because later hooks see reassembled datagrams
    "add table netdev loss; add chain netdev loss c {{ type filter hook ingress device eth0 priority 0; }}; "
    "add rule netdev loss c numgen random mod 1000 < {share} drop"
)


class Hosts:
    """The two hosts, with numbers 0 and 1; see `two_hosts`."""

    def __init__(self, names: Sequence[str]):
        self._names = names

    def start(
        self, number: int, words: Sequence[str], environment: Mapping[str, str]
    ) -> subprocess.Popen[bytes]:
        """Start a program on a host."""
        inside = ["ip", "netns", "exec", self._names[number], "sh", "-c", ALONE, "sh", *words]
        return subprocess.Popen(inside, env=dict(environment), stderr=subprocess.DEVNULL)

    def lose(self, share: float) -> None:
        """Drop this share of all packets from now on; 0 = none."""
        for name in self._names:
            inside = ["ip", "netns", "exec", name, "nft"]
            if share:
                _run([*inside, TABLE.format(share=round(1000 * share))])
            else:
                _run([*inside, "delete table netdev loss"])


@contextmanager
def two_hosts() -> Iterator[Hosts]:
    """Create the two hosts, and remove them on exit.

    Raises:
        EnvironmentProblem: if the machine or the user lacks support for network namespaces or packet loss.
    """
    missing = [name for name in ("ip", "nft") if shutil.which(name) is None]
    if missing:
        raise EnvironmentProblem(f"{' and '.join(missing)} not found: apt install iproute2 nftables")
    names = [f"panoptic-{os.getpid()}-{k}" for k in range(2)]
    try:
        for name in names:
            _run(["ip", "netns", "add", name])
        _run(
            [
                "ip",
                "-n",
                names[0],
                "link",
                "add",
                "name",
                "eth0",
                "type",
                "veth",
                "peer",
                "name",
                "eth0",
                "netns",
                names[1],
            ]
        )
        for k, name in enumerate(names):
            for words in (
                f"addr add 10.77.0.{10 + k}/24 dev eth0",
                "link set eth0 up",
                "link set lo up",
                "route add default dev eth0",
            ):
                _run(["ip", "-n", name, *words.split()])
        yield Hosts(names)
    finally:
        for name in names:
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


def _run(words: Sequence[str]) -> None:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise EnvironmentProblem(
            f"{' '.join(words[:4])} ...: {said[0] if said else 'failed'}; hosts on one machine need root and "
            "a kernel with network namespaces and nftables"
        )
