"""Network namespaces with addresses of their own on one bridge, which can be cut off."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

_LINKS = "ip -oneline link show"
_NOBODY = "02:00:00:00:00:01"
"""Address of an interface that there is not."""


class Network:
    """A bridge of this machine and addresses with names.

    This machine itself is part of it, as `gateway`.
    """

    def __init__(self, name: str, prefix: str) -> None:
        self._name, self._prefix = name, prefix
        self.gateway = f"{prefix}.1"
        self.names: dict[str, str] = {}
        _run(f"ip link add {name} type bridge")
        _run(f"ip address add {self.gateway}/24 dev {name}")
        _run(f"ip link set {name} up")

    def place(self, name: str) -> str:
        """Make the namespace of a container, and return its address."""
        self.names[name] = address = f"{self._prefix}.{len(self.names) + 10}"
        space, outer = self.space(name), self._outer(name)
        _run(f"ip netns add {space}")
        _run(f"ip link add {outer} type veth peer name eth0 netns {space}")
        _run(f"ip link set {outer} master {self._name} up")
        _run(f"ip -n {space} address add {address}/24 dev eth0")
        _run(f"ip -n {space} link set eth0 up")
        _run(f"ip -n {space} link set lo up")
        return address

    def space(self, name: str) -> str:
        """Return the name of the namespace of a container."""
        return f"{self._name}-{name}"

    def _outer(self, name: str) -> str:
        """Return the end of its cable that is at the bridge."""
        return f"{self._name[:6]}{list(self.names).index(name) + 1}"

    def within(self, name: str) -> list[str]:
        """Return what is written before a command that runs in a namespace."""
        return ["ip", "netns", "exec", self.space(name)]

    def write_hosts(self, **more: list[str]) -> None:
        """Let commands in the namespaces know all names, and some that stand for several."""
        lines = [f"{address} {name}" for name, address in self.names.items()]
        lines += [f"{self.names[each]} {name}" for name, some in more.items() for each in some]
        for name in self.names:
            folder = Path("/etc/netns") / self.space(name)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "hosts").write_text("\n".join(["127.0.0.1 localhost", *lines, ""]))

    def forbid(self, name: str, other: str) -> None:
        """Let no packet of one container reach another, and tell it so."""
        _run(f"ip -n {self.space(name)} route add unreachable {self.names[other]}")

    def cut(self, name: str, other: str) -> None:
        """Lose all packets between two places, in both directions, without telling anybody."""
        for one, two in ((name, other), (other, name)):
            place, device = self._at(one)
            address = self.names.get(two, self.gateway)
            _run(f"{place} neigh replace {address} lladdr {_NOBODY} nud permanent dev {device}")

    def heal(self, name: str, other: str) -> None:
        """Lose no packets between two places any more."""
        for one, two in ((name, other), (other, name)):
            place, device = self._at(one)
            _run(f"{place} neigh del {self.names.get(two, self.gateway)} dev {device}")

    def _at(self, name: str) -> tuple[str, str]:
        """Return the command for a place, a name or else this machine, and its interface."""
        known = name in self.names
        return (f"ip -n {self.space(name)}", "eth0") if known else ("ip", self._name)

    def unplug(self, name: str) -> None:
        """Pull the cable of a namespace."""
        _run(f"ip link set {self._outer(name)} down")

    def plug(self, name: str) -> None:
        """Put it in again."""
        _run(f"ip link set {self._outer(name)} up")

    def processes(self, name: str) -> list[int]:
        """Return the processes in a namespace."""
        return [int(line) for line in _output(f"ip netns pids {self.space(name)}").split()]

    def signal(self, name: str, number: signal.Signals) -> list[int]:
        """Send a signal to all processes in a namespace, and return them."""
        processes = self.processes(name)
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process, number)
        return processes

    def kill(self, name: str) -> None:
        """Kill all processes in a namespace, as the end of a container's first one does."""
        end = time.monotonic() + 30.0
        while processes := self.signal(name, signal.SIGKILL):
            assert time.monotonic() < end, f"{name}: {processes} do not die"
            time.sleep(0.02)

    def close(self) -> None:
        """Remove all, whatever became of it."""
        remove(self._name)


def remove(name: str) -> None:
    """Kill what runs in the namespaces of a network, and remove them, whoever left them."""
    spaces = [line.split()[0] for line in _output("ip netns list").splitlines()]
    for space in (each for each in spaces if each.startswith(f"{name}-")):
        for process in _output(f"ip netns pids {space}").split():
            with suppress(ProcessLookupError):
                os.kill(int(process), signal.SIGKILL)
        _run(f"ip netns del {space}")
        shutil.rmtree(Path("/etc/netns") / space, ignore_errors=True)
    # The kernel takes its time with those of a namespace whose processes are still ending.
    links = [line.split(":")[1].split("@")[0].strip() for line in _output(_LINKS).splitlines()]
    for link in (each for each in links if re.fullmatch(rf"{name[:6]}\d+|{name}", each)):
        subprocess.run(["ip", "link", "del", link], check=False, capture_output=True)


def _output(line: str) -> str:
    return subprocess.run(line.split(), check=True, capture_output=True, text=True).stdout


def _run(line: str) -> None:
    subprocess.run(line.split(), check=True)
