"""A cluster of parts, each with a network namespace and an address of its own.

Two replicas, scheduler, three machines of workers, PostgreSQL, a store that speaks S3, and the
proxy of `docker/cluster`. The processes of the tests are the clients.
"""

from __future__ import annotations

import os
import shutil
import signal
import ssl
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx2
import yaml
from processes import Process, Record, Replica, program, until
from shared import Machine

from tests.conftest import PostgreSQL, programs
from tests.container.network import Network
from tests.service.object_store import Server
from vibroimpact_service.jobs import certificates

REPLICAS = ("replica-a", "replica-b")
WORKERS = ("worker-1", "worker-2", "worker-3")
PARTS = ("database", "store", "scheduler", *WORKERS, *REPLICAS, "proxy")
"""In the order in which they are started."""
CLIENTS = "clients"
"""This machine."""
RESTART_SECONDS = 1.0
"""Time after which a supervisor starts again what has ended."""
READY_SECONDS = 120.0
DEPLOYED = Path(__file__).parents[3] / "docker" / "cluster"


class Cluster:
    """The parts, what starts them, and what strikes them."""

    def __init__(self, network: Network, folder: Path) -> None:
        self.network, self.folder = network, folder
        self.record = Record(folder / "record")
        self.address = {name: network.place(name) for name in PARTS}
        network.write_hosts(service=list(REPLICAS))
        self.running: dict[str, Any] = {}
        self._database: PostgreSQL | None = None
        # Its user is nobody, who may not enter the folders of the tests.
        self._proxy = Path(tempfile.mkdtemp(prefix="vibroimpact-proxy-"))
        self._https: list[httpx2.Client] = []
        self.machine = Machine()

    def begin(self) -> None:
        """Start all parts and wait until the cluster does work."""
        ca, cert, key = certificates.write(self.folder / "tls", days=2)
        self.settings = {
            "VIBROIMPACT_TLS_CA": str(ca),
            "VIBROIMPACT_TLS_CERT": str(cert),
            "VIBROIMPACT_TLS_KEY": str(key),
            "VIBROIMPACT_SCHEDULER": "tls://scheduler:8786",
            "VIBROIMPACT_STORE": "s3://bucket/vibroimpact",
            "AWS_ENDPOINT_URL": f"http://{self.address['store']}:9000",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
            "RECORD": str(self.record.path),
        }
        for name in PARTS:
            self.start(name)
        for name in REPLICAS:
            until(self.running[name].ready, f"{name} is not ready", READY_SECONDS)

    def close(self) -> None:
        """Kill all, and remove what is not in the folder of the tests."""
        for client in self._https:
            client.close()
        for name in PARTS:
            self._forget(name)
        if self._database is not None:
            self._database.stop()
        shutil.rmtree(self._proxy)
        self.machine.close()

    def _forget(self, name: str) -> None:
        """Kill a part, and wait for its processes as their parent."""
        self.network.kill(name)
        part = self.running.pop(name, None)
        if part is not None:
            part.process.wait(30)
            if isinstance(part, Replica):
                part.http.close()

    # What starts them.

    def start(self, name: str) -> None:
        """Start a part, as its supervisor does."""
        start: dict[str, Callable[[str], Any]] = {
            "database": self._start_database,
            "store": self._start_store,
            "scheduler": self._start_scheduler,
            "proxy": self._start_proxy,
            **dict.fromkeys(WORKERS, self._start_worker),
            **dict.fromkeys(REPLICAS, self._start_replica),
        }
        self.running[name] = start[name](name)
        self.machine.owns(self.running[name].process.pid)

    def _start_database(self, name: str) -> Any:
        if self._database is None:
            within = self.network.within(name)
            self._database = PostgreSQL(programs(), self.address[name], within)
            self.database = self._database.new()
        else:
            self._database.start()
        return self._database

    def _start_store(self, name: str) -> Any:
        """Start a store that is empty: this one keeps nothing over its end."""
        log = self.folder / "store.txt"
        server = Server(log, self.address[name], self.network.within(name), 9000)
        httpx2.put(f"{server.url}/bucket").raise_for_status()
        return server

    def _command(self, name: str, *words: str) -> Process:
        command = [*self.network.within(name), *program(*words)]
        return Process(command, self.folder / name, **self.settings)

    def _start_scheduler(self, name: str) -> Process:
        return self._command(name, "scheduler", "--host", self.address[name])

    def _start_worker(self, name: str) -> Process:
        return self._command(name, "worker", "--workers", "1")

    def _start_replica(self, name: str) -> Replica:
        return Replica(
            self.folder / name,
            self.record,
            self.network.within(name),
            host=self.address[name],
            port="8000",
            access="keys",
            database=self.database,
            max_unfinished_jobs="100000",
            metrics_host=self.address[name],
            metrics_port="8001",
            **self.settings,
        )

    def _start_proxy(self, name: str) -> Process:
        shutil.copy(DEPLOYED / "Caddyfile", self._proxy)
        shutil.chown(self._proxy, "nobody", "nogroup")
        services = yaml.safe_load((DEPLOYED / "compose.yaml").read_text())["services"]
        for key, value in services["proxy"]["sysctls"].items():
            set_it = ["sysctl", "-q", "-w", f"{key}={value}"]
            subprocess.run([*self.network.within(name), *set_it], check=True)
        as_nobody = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups"]
        as_nobody += ["--inh-caps=+net_bind_service", "--ambient-caps=+net_bind_service"]
        caddy = ["caddy", "run", "--adapter", "caddyfile", "--config", f"{self._proxy}/Caddyfile"]
        return Process(
            [*self.network.within(name), *as_nobody, *caddy],
            self.folder / name,
            VIBROIMPACT_NAME=self.address[name],
            XDG_DATA_HOME=str(self._proxy),
            XDG_CONFIG_HOME=str(self._proxy),
            HOME=str(self._proxy),
        )

    # Those who ask them.

    def key(self, owner: str, *scopes: str) -> str:
        """Make a key, as an operator does."""
        chosen = [word for scope in scopes for word in ("--scope", scope)]
        limits = ["--requests-per-minute", "1000000", "--seconds-per-hour", "10000000"]
        return subprocess.run(
            program("keys", "create", owner, *chosen, *limits),
            env={**os.environ, "VIBROIMPACT_DATABASE": self.database},
            check=True, capture_output=True, text=True,
        ).stdout.split()[-1]  # fmt: skip

    @property
    def authority(self) -> str:
        """The file of the authority that has certified the proxy."""
        return str(self._proxy / "caddy" / "pki" / "authorities" / "local" / "root.crt")

    def client(self, key: str, timeout: float = 10.0) -> httpx2.Client:
        """Return a client of the proxy, which believes the authority of this proxy alone."""
        until(Path(self.authority).exists, "the proxy has no authority")
        made = httpx2.Client(
            base_url=f"https://{self.address['proxy']}",
            headers={"Authorization": f"Bearer {key}"},
            verify=ssl.create_default_context(cafile=self.authority),
            timeout=timeout,
        )
        self._https.append(made)
        return made

    def ready(self, name: str) -> bool:
        """Whether a replica says so itself."""
        url = f"http://{self.address[name]}:8001/v1/health/ready"
        with suppress(httpx2.TransportError):
            return bool(httpx2.get(url, timeout=5).is_success)
        return False

    def begun(self, name: str, moment: float) -> float | None:
        """Return when a machine of workers first began a chunk since, or None."""
        processes = set(self.network.processes(name))
        times = (b.time for b in self.record.begun() if b.time > moment and b.pid in processes)
        return next(times, None)

    # What strikes them.

    @contextmanager
    def killed(self, name: str) -> Iterator[None]:
        """Kill a part; its supervisor starts it again."""
        self._forget(name)
        time.sleep(RESTART_SECONDS)
        self.start(name)
        yield

    @contextmanager
    def without_power(self, name: str) -> Iterator[None]:
        """Switch the machine of a part off, which says nothing to others, and on again."""
        self.network.unplug(name)
        self._forget(name)
        try:
            yield
        finally:
            self.network.plug(name)
            self.start(name)

    @contextmanager
    def unplugged(self, name: str) -> Iterator[None]:
        """Pull the cable of a part, and put it in again."""
        self.network.unplug(name)
        try:
            yield
        finally:
            self.network.plug(name)

    @contextmanager
    def standing(self, name: str) -> Iterator[None]:
        """Stop all processes of a part, and let them go on."""
        self.network.signal(name, signal.SIGSTOP)
        try:
            yield
        finally:
            self.network.signal(name, signal.SIGCONT)

    @contextmanager
    def cut(self, *pairs: tuple[str, str]) -> Iterator[None]:
        """Lose all packets between some pairs of parts."""
        for pair in pairs:
            self.network.cut(*pair)
        try:
            yield
        finally:
            for pair in pairs:
                self.network.heal(*pair)
