"""Containers without an engine: namespaces, a read-only tree, and limits as a compose file says.

What an engine would do with a service of a compose file is done here with `unshare`, bind mounts
and control groups; what the file says that is not known here is an error, not ignored.
"""

from __future__ import annotations

import os
import shlex
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from tests.container import compose
from tests.container.network import Network

_OF_THE_ENGINE = {
    "build", "image", "restart", "ports", "depends_on", "healthcheck", "networks", "environment",
    "command", "volumes", "read_only", "tmpfs", "cap_drop", "security_opt", "deploy",
    "stop_grace_period",
}  # fmt: skip
_OPTIONS = ("size", "mode")


class Image(NamedTuple):
    """The file system of an image, and its configuration."""

    tree: Path
    configuration: Mapping[str, Any]

    @property
    def user(self) -> tuple[int, int]:
        """The numbers of the user and the group that run its commands."""
        name = self.configuration["User"]
        lines = (self.tree / "etc/passwd").read_text().splitlines()
        (entry,) = (line.split(":") for line in lines if line.split(":")[0] == name)
        return int(entry[2]), int(entry[3])


class Relay:
    """Passes connections from an address in a network on to a server on this machine."""

    def __init__(self, address: tuple[str, int], server: tuple[str, int]) -> None:
        self._server = server
        self._listener = socket.create_server(address)
        self._ends: list[socket.socket] = [self._listener]
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """Close everything."""
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        with suppress(OSError):  # as its closing is
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._server)
                self._ends += client, server
                for pair in ((client, server), (server, client)):
                    threading.Thread(target=self._pass, args=pair, daemon=True).start()

    def _pass(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(2**16):
                target.sendall(data)
        with suppress(OSError):
            target.shutdown(socket.SHUT_WR)


class Limits:
    """The control groups of a container: memory, processes, and what of them was used."""

    _FIRST = ("memory/{}/memory.limit_in_bytes", "pids/{}/pids.max", "cpu/{}/cpu.cfs_quota_us")
    _SECOND = ("{}/memory.max", "{}/pids.max", "{}/cpu.max")

    def __init__(self, name: str, memory: int, pids: int, cpus: float | None) -> None:
        root = Path("/sys/fs/cgroup")
        self._second = (root / "cgroup.controllers").exists()
        if self._second:
            (root / "cgroup.subtree_control").write_text("+memory +pids +cpu")
        patterns = self._SECOND if self._second else self._FIRST
        files = [root / each.format(name) for each in patterns]
        self.folders = sorted({file.parent for file in files})
        for folder in self.folders:
            folder.mkdir()
        files[0].write_text(str(memory))
        files[1].write_text(str(pids))
        if cpus is not None:
            quota = str(int(cpus * 100_000))
            files[2].write_text(f"{quota} 100000" if self._second else quota)
        peak = "memory.peak" if self._second else "memory.max_usage_in_bytes"
        self._peak = files[0].with_name(peak)

    def peak(self) -> int:
        """Return the largest memory that was used so far, files in memory included [bytes]."""
        return int(self._peak.read_text())

    def close(self) -> None:
        """Remove the groups, once their processes have ended."""
        for folder in self.folders:
            end = time.monotonic() + 10
            while folder.exists():
                try:
                    folder.rmdir()
                except OSError:
                    assert time.monotonic() < end, f"processes are left in {folder}"
                    time.sleep(0.05)


class Container:
    """A running container of a service of a compose file.

    Parameters
    ----------
    image : Image
    service : dict
        The service, as `compose.read` returns it.
    network : Network
    name : str
        Of the container in the network.
    folder : Path
        For mount points, outputs and volumes of this container.
    volumes : dict
        Name -> folder of the volumes that containers share.
    command, environment
        In place of, and in addition to, those of the service.
    group : int, optional
        A further group of its processes, as `fsGroup` in Kubernetes is.
    """

    def __init__(
        self,
        image: Image,
        service: Mapping[str, Any],
        network: Network,
        name: str,
        folder: Path,
        volumes: Mapping[str, Path],
        command: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
        group: int | None = None,
    ) -> None:
        assert set(service) <= _OF_THE_ENGINE, set(service) - _OF_THE_ENGINE
        self.name, self.address, self.image = name, network.place(name), image
        self._space = network.space(name)
        self._folder = folder / name
        self._folder.mkdir(parents=True)
        self.root = self._folder / "root"
        self.root.mkdir()
        self.output = self._folder / "output"
        self.grace = compose.seconds(service["stop_grace_period"])
        configuration = image.configuration
        self.environment = dict(each.split("=", 1) for each in configuration["Env"])
        self.environment |= {k: str(v) for k, v in service.get("environment", {}).items()}
        self.environment |= environment or {}
        limits = service["deploy"]["resources"]["limits"]
        cpus = float(limits["cpus"]) if "cpus" in limits else None
        memory = compose.number_of_bytes(limits["memory"])
        self.limits = Limits(self._space, memory, int(limits["pids"]), cpus)
        hosts = self._folder / "hosts"
        known = {"localhost": "127.0.0.1", **network.names}
        hosts.write_text("".join(f"{address} {name}\n" for name, address in known.items()))
        given = list(command or service.get("command", configuration["Cmd"]))
        words = [*configuration["Entrypoint"], *given]
        self._groups = "--clear-groups" if group is None else f"--groups {group}"
        self.volumes: dict[str, Path] = {}
        """Place in the container -> folder outside."""
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        script = [*self._mounts(service, volumes, hosts), self._entering(words)]
        self.began = time.monotonic()
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                ["ip", "netns", "exec", self._space, "unshare", "--mount", "--pid", "--ipc",
                 "--uts", "--fork", "--kill-child", "--propagation", "private",
                 "sh", "-ec", "\n".join(script)],
                env=self.environment, stdout=output, stderr=output, preexec_fn=self._enter_groups,
            )  # fmt: skip

    def _enter_groups(self) -> None:
        for folder in self.limits.folders:
            (folder / "cgroup.procs").write_text("0")

    def _mounts(
        self, service: Mapping[str, Any], volumes: Mapping[str, Path], hosts: Path
    ) -> list[str]:
        """Return the lines of shell that make the file system."""
        tree, root = self.image.tree, self.root
        lines = [f"mount --bind {tree} {root}"]
        if service.get("read_only"):
            lines.append(f"mount -o remount,bind,ro {root}")
        lines += [f"mount -t proc proc {root}/proc", f"mount -t tmpfs -o mode=755 dev {root}/dev"]
        for device in ("null", "zero", "full", "random", "urandom"):
            lines.append(f"touch {root}/dev/{device}")
            lines.append(f"mount --bind /dev/{device} {root}/dev/{device}")
        memory = f"{root}/dev/shm"
        lines.append(f"mkdir {memory}\nmount -t tmpfs -o mode=1777,size=64m shm {memory}")
        lines.append(f"mount --bind {hosts} {root}/etc/hosts")
        mounted = {path.split(":")[1]: path for path in service.get("volumes", ())}
        for place in self.image.configuration.get("Volumes") or {}:
            mounted.setdefault(place, f":{place}")
        for place, entry in mounted.items():
            source, _, *access = entry.split(":")
            folder = volumes.get(source, self._folder / "volumes" / place.lstrip("/"))
            self.volumes[place] = folder
            _new_volume(folder, tree / place.lstrip("/"))
            lines.append(f"mount --bind {folder} {root}{place}")
            if access == ["ro"]:
                lines.append(f"mount -o remount,bind,ro {root}{place}")
        for entry in service.get("tmpfs", ()):
            place, _, options = entry.partition(":")
            assert all(option.split("=")[0] in _OPTIONS for option in options.split(",")), entry
            lines.append(f"mount -t tmpfs -o {options},nosuid,nodev {place} {root}{place}")
        return lines

    def _entering(self, words: Sequence[str]) -> str:
        """Return the line of shell that becomes a command in the container."""
        user, group = self.image.user
        rights = f"--reuid {user} --regid {group} {self._groups} --no-new-privs"
        rights += " --inh-caps=-all --bounding-set=-all"
        return f"exec chroot {self.root} setpriv {rights} -- {shlex.join(words)}"

    @property
    def first(self) -> int:
        """The number, outside, of its first process."""
        pid = self.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return int(children[0])

    def execute(
        self, words: Sequence[str], seconds: float = 30
    ) -> subprocess.CompletedProcess[str]:
        """Run another command in it, as `docker exec` and health checks do."""
        enter = ["nsenter", "-t", str(self.first), "--mount", "--pid", "--ipc", "--net", "--uts"]
        line = self._entering(words)
        return subprocess.run(
            [*enter, "sh", "-c", line], env=self.environment, text=True, capture_output=True,
            check=False, timeout=seconds,
        )  # fmt: skip

    def until(self, condition: Callable[[], Any], what: str, seconds: float = 60) -> Any:
        """Wait for a condition while it runs, and return its value."""
        end = time.monotonic() + seconds
        while not (value := condition()):
            assert self.process.poll() is None, self.output.read_text()
            assert time.monotonic() < end, f"{what}\n{self.output.read_text()}"
            time.sleep(0.02)
        return value

    def processes(self) -> dict[int, dict[str, str]]:
        """Return the entries of /proc/…/status of all processes in it, by their number outside."""
        states = {}
        for number in map(int, (self.limits.folders[0] / "cgroup.procs").read_text().split()):
            text = Path(f"/proc/{number}/status").read_text()
            entries = dict(line.split(":\t", 1) for line in text.splitlines() if ":\t" in line)
            if number != self.process.pid:  # which only waits for the first one
                states[number] = entries
        return states

    def wait(self, seconds: float = 60) -> int:
        """Wait for its end and return the exit code."""
        return self.process.wait(seconds)

    def stop(self) -> tuple[int, float]:
        """Send SIGTERM; return the exit code and the seconds to the end."""
        start = time.monotonic()
        os.kill(self.first, signal.SIGTERM)
        return self.process.wait(60), time.monotonic() - start

    def close(self) -> None:
        """End it, whatever it does, and remove what it had."""
        if self.process.poll() is None:
            os.kill(self.first, signal.SIGKILL)  # and with it all in its namespace
            self.process.wait(30)
        self.limits.close()


def _new_volume(folder: Path, place: Path) -> None:
    """Make a volume as engines do: with owner, rights and contents of its place in the image."""
    if folder.exists():
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    subprocess.run(["cp", "-a", str(place), str(folder)], check=True)
