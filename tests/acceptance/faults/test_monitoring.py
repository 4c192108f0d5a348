"""Prometheus reads two replicas that require keys; each alert fires by its fault, and then ends."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx2
import psycopg
import pytest
import yaml
from processes import Process, Record, Replica, program, until
from prometheus import FOLDER, WINDOW, Prometheus, free_port
from prometheus import program as of_prometheus
from users import sweep, tiny

from tests.conftest import PostgreSQL, programs
from tests.service.jobs.test_webhooks import SECRET, Receiver
from vibroimpact_service.jobs import certificates
from vibroimpact_service.use_case import warming
from vibroimpact_solvers.kernels import cache

THRESHOLDS = {
    "VibroimpactQueueOld": "3",
    "VibroimpactWorkerDeaths": "0",
    "VibroimpactEventLoopLag": "1",
    "VibroimpactDatabaseSlow": "1",
}
"""Alerts -> numbers that their faults reach within seconds, and that the load of a machine which
is busy with other things does not reach."""


FIRST, SECOND = (pytest.mark.xdist_group(f"{name} cluster") for name in ("first", "second"))
"""Two clusters beside one another. On each, tests follow one another: an alert that fires must end
before the next one is waited for."""


class Cluster:
    """Database, scheduler, worker, two replicas, a receiver of webhooks, and their Prometheus."""

    def __init__(self, folder: Path, opened: ExitStack) -> None:
        self.folder, self.record, self._opened = folder, Record(folder / "record"), opened
        self.database = PostgreSQL(programs())
        opened.callback(self.database.stop)
        (folder / "receiver").mkdir()
        self.receiver = Receiver(folder / "receiver")
        opened.callback(self.receiver.close)
        self.disk = folder / "disk"
        self.disk.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", str(self.disk)]
        self.mounted = not subprocess.run(mount, capture_output=True, check=False).returncode
        if self.mounted:
            unmount = ["umount", "-l", str(self.disk)]
            opened.callback(lambda: subprocess.run(unmount, check=True))
        ca, cert, key = certificates.write(folder / "tls", days=30)
        self.settings = {
            "database": self.database.new(),
            "store": str(self.disk),
            "scheduler": f"tls://127.0.0.1:{free_port()}",
            "tls_ca": str(ca),
            "tls_cert": str(cert),
            "tls_key": str(key),
            "access": "keys",
            "clean_seconds": "3",
            "webhook_private": "true",
            "webhook_ca": str(self.receiver.authority),
        }
        self.environment = {f"VIBROIMPACT_{k.upper()}": v for k, v in self.settings.items()}
        self.key = self._key("ann")
        self.key_of_prometheus = self._key("prometheus", "--scope", "metrics")
        port = self.settings["scheduler"].rpartition(":")[2]
        self._process("scheduler", "scheduler", "--port", port)
        self.start_worker()
        self.ports = {name: free_port() for name in "ab"}
        self.replicas = {name: self.start_replica(name) for name in self.ports}
        for replica in self.replicas.values():
            until(replica.ready, "it is not ready")
        targets = [f"127.0.0.1:{port}" for port in self.ports.values()]
        self.prometheus = Prometheus(folder / "prometheus", targets, **THRESHOLDS)
        opened.callback(self.prometheus.end)
        # What counts from 0 has no increase to one that has not read the 0.
        until(
            lambda: {each["health"] for each in self.prometheus.targets()} == {"up"},
            "Prometheus does not read the replicas",
        )

    def _key(self, *arguments: str) -> str:
        created = subprocess.run(
            program("keys", "create", *arguments),
            env={**os.environ, **self.environment},
            capture_output=True,
            text=True,
            check=True,
        )
        (key,) = re.findall(r"vik_\S+", created.stdout)
        return str(key)

    def _process(self, name: str, *command: str) -> Process:
        files = {"RECORD": str(self.record.path), "RECORD_FAIL": str(self.folder / "fail")}
        process = Process(program(*command), self.folder / name, **files, **self.environment)
        self._opened.callback(process.end)
        return process

    def start_worker(self) -> None:
        """Start the worker; the one process in it has a parent that replaces it."""
        address = self.settings["scheduler"]
        self.worker = self._process("worker", "worker", address, "--workers", "1")

    def start_replica(self, name: str, **more: str) -> Replica:
        """Start a replica, with its own port for metrics."""
        metrics = {"metrics_port": str(self.ports[name])}
        replica = Replica(self.folder / name, self.record, **self.settings, **metrics, **more)
        self._opened.callback(replica.end)
        replica.http.headers["Authorization"] = f"Bearer {self.key}"
        return replica

    def submit(self, content: dict[str, Any], name: str = "a", **more: Any) -> str:
        """Submit a job to a replica and return its id."""
        body = {"kind": "impact-modes", "request": content, **more}
        answer = self.replicas[name].http.post("/v1/jobs", json=body)
        assert answer.status_code == 201, answer.text
        job: str = answer.json()["id"]
        return job

    def done(self, job: str) -> dict[str, Any] | None:
        """Return a job that has ended, or None."""
        document: dict[str, Any] = self.replicas["a"].http.get(f"/v1/jobs/{job}?wait=5").json()
        return document if document["final"] else None

    @contextmanager
    def firing(self, *alerts: str, meanwhile: Callable[[], None] = lambda: None) -> Iterator[None]:
        """Wait for alerts to fire, once a fault is there, and for all to end after it.

        What the context does against the fault is done whether they fire or not: the next test
        begins without it. `meanwhile` is called again and again while they do not fire yet.
        """
        begin, failed = time.monotonic(), None

        def fire() -> bool:
            meanwhile()
            return self.prometheus.firing() >= set(alerts)

        try:
            until(fire, "", 60)
        except AssertionError:
            failed = f"of {', '.join(alerts)} only fire {self.prometheus.firing()}"
        fired = time.monotonic()
        print(f"{', '.join(alerts)}: fired after {fired - begin:.1f} s", end="", flush=True)
        yield
        assert failed is None, failed
        end = time.monotonic()
        until(lambda: not self.prometheus.firing(), "an alert does not end", 60)
        print(f", ended after {time.monotonic() - end:.1f} s", flush=True)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    of_prometheus("prometheus")
    with ExitStack() as opened:
        yield Cluster(tmp_path_factory.mktemp("cluster"), opened)


@FIRST
def test_a_key_is_needed_at_one_port_and_not_at_the_other(cluster: Cluster) -> None:
    until(
        lambda: {each["health"] for each in cluster.prometheus.targets()} == {"up"},
        "Prometheus does not read the replicas",
    )
    replica = cluster.replicas["a"]
    for key, status in ((None, 401), (cluster.key, 403), (cluster.key_of_prometheus, 200)):
        headers = {"Authorization": f"Bearer {key}"}
        assert replica.http.get("/metrics", headers=headers).status_code == status
    inside = json.loads(replica.note.read_text())["metrics"]
    assert replica.http.get(f"{inside}/v1/jobs").status_code == 404
    assert replica.http.get(f"{inside}/v1/health/ready").status_code == 200


@FIRST
def test_every_query_of_the_dashboard_has_data(cluster: Cluster) -> None:
    jobs = [cluster.submit(tiny(0.7 + i / 100)) for i in range(3)]
    webhook = {"url": cluster.receiver.url, "secret": SECRET}
    first = cluster.submit(sweep(0.6), webhook=webhook)
    failing = cluster.submit(sweep(0.9), deadline_seconds=0.01)
    http = cluster.replicas["a"].http
    assert http.post("/v1/compute/impact-modes", json=tiny(1.0)).status_code == 200
    computed = "vibroimpact_solve_seconds_count"
    until(lambda: cluster.prometheus.query(computed), "no computation is counted")
    # A rate needs two values of a series, and this one begins with the first computation.
    assert http.post("/v1/compute/impact-modes", json=tiny(1.01)).status_code == 200
    with http.stream("GET", f"/v1/jobs/{first}/events") as events:
        assert events.status_code == 200
        next(events.iter_bytes())
        for job in (*jobs, first, failing):
            until(lambda job=job: cluster.done(job), f"{job} does not end")
    dashboard = json.loads((FOLDER / "dashboard.json").read_text())
    queries = [
        target["expr"].replace("$__rate_interval", "2m")
        for panel in dashboard["panels"]
        for target in panel.get("targets", ())
    ]
    assert len(queries) > 25
    empty = set(queries)

    def answered() -> bool:
        for query in tuple(empty):
            values = [float(each["value"][1]) for each in cluster.prometheus.query(query)]
            if any(value == value for value in values):  # not NaN
                empty.discard(query)
        return not empty

    with contextlib.suppress(AssertionError):
        until(answered, "", 30)
    assert empty == set()
    series = len(cluster.prometheus.query('{instance=~".+"}')) / 2
    print("series per replica:", series)
    assert series < 1500


@FIRST
def test_nothing_fires_without_a_fault(cluster: Cluster) -> None:
    until(lambda: not cluster.prometheus.firing(), "an alert fires", 30)

    def health() -> set[str]:
        rules = cluster.prometheus.http.get("/api/v1/rules").json()["data"]["groups"][0]["rules"]
        return {rule["health"] for rule in rules}

    until(lambda: health() == {"ok"}, "a rule is not evaluated", 30)


@FIRST
def test_no_workers(cluster: Cluster) -> None:
    cluster.worker.end()
    # One that asks a moment before would begin the job, which then is not queued any more.
    until(lambda: not any(each.ready() for each in cluster.replicas.values()), "one is ready")
    job = cluster.submit(tiny(1.1))
    with cluster.firing("VibroimpactNoWorkers", "VibroimpactNotReady", "VibroimpactQueueOld"):
        cluster.start_worker()
        until(lambda: cluster.done(job), "the job does not end")


@FIRST
def test_deaths_of_workers(cluster: Cluster) -> None:
    job = cluster.submit(sweep(0.61))
    moment = time.time()
    worker = until(lambda: cluster.record.after(moment), "nothing begins").pid
    os.kill(worker, signal.SIGKILL)
    with cluster.firing("VibroimpactWorkerDeaths"):
        until(lambda: cluster.done(job), "the job does not end")


@FIRST
def test_a_killed_replica(cluster: Cluster) -> None:
    job = cluster.submit(sweep(0.62))

    def holder() -> str | None:
        attempts = cluster.replicas["a"].http.get(f"/v1/jobs/{job}").json()["history"]
        pids = {str(each.process.pid): name for name, each in cluster.replicas.items()}
        names = [pids.get(each["worker"].split("-")[-2]) for each in attempts]
        return names[0] if names else None

    name = until(holder, "no replica holds the job")
    cluster.replicas[name].kill()
    with cluster.firing("VibroimpactReplicaDown", "VibroimpactClaimsExpired"):
        cluster.replicas[name] = cluster.start_replica(name)
        until(lambda: cluster.done(job), "the job does not end")


@FIRST
def test_a_dead_database(cluster: Cluster) -> None:
    cluster.database.kill()

    def ask() -> None:  # however late Prometheus reads the first number, others follow
        assert cluster.replicas["a"].http.get("/v1/jobs").status_code == 503

    with cluster.firing("VibroimpactDatabaseFailing", "VibroimpactServerErrors", meanwhile=ask):
        cluster.database.start()
        until(cluster.replicas["a"].ready, "it is not ready")


@FIRST
def test_a_full_store(cluster: Cluster) -> None:
    if not cluster.mounted:
        pytest.skip("mounting a file system is not permitted here")
    filler = cluster.disk / "filler"
    with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))
    with cluster.firing("VibroimpactStoreFailing", "VibroimpactStoreNearlyFull"):
        filler.unlink()


@SECOND
def test_failing_jobs(cluster: Cluster) -> None:
    failure = cluster.folder / "fail"
    failure.touch()
    job = cluster.submit(sweep(0.63))
    ended = until(lambda: cluster.done(job), "the job does not end")
    assert ended["error"]["code"] == "internal_error"
    with cluster.firing("VibroimpactJobsFailing"):
        failure.unlink()


@SECOND
def test_failing_webhooks(cluster: Cluster) -> None:
    cluster.receiver.statuses = [500]
    before = len(cluster.receiver.got)
    cluster.submit(tiny(1.2), webhook={"url": cluster.receiver.url, "secret": SECRET})
    with cluster.firing("VibroimpactWebhookFailures"):
        until(lambda: len(cluster.receiver.got) == before + 2, "it is not delivered")


@contextmanager
def again_and_again(strike: Callable[[], None], pause: float = 0.2) -> Iterator[Callable[[], None]]:
    """Repeat a fault until the end of the context, or until what it gives is called."""
    ended = threading.Event()

    def repeat() -> None:
        while not ended.is_set():
            strike()
            ended.wait(pause)

    thread = threading.Thread(target=repeat)

    def end() -> None:
        ended.set()
        thread.join()

    thread.start()
    try:
        yield end
    finally:
        end()


@SECOND
def test_a_slow_database(cluster: Cluster) -> None:
    """Somebody else locks the table of jobs for two seconds, whenever he can."""
    url = cluster.settings["database"]

    def lock() -> None:
        with psycopg.connect(url) as connection:
            connection.execute("LOCK TABLE jobs IN ACCESS EXCLUSIVE MODE")
            time.sleep(2.0)

    def ask() -> None:
        with contextlib.suppress(httpx2.TransportError):
            cluster.replicas["a"].http.get("/v1/jobs", timeout=5.0)

    fired = cluster.firing("VibroimpactDatabaseSlow")
    with again_and_again(lock) as end, again_and_again(ask), fired:
        end()


@SECOND
def test_an_event_loop_that_lags(cluster: Cluster) -> None:
    replica = cluster.replicas["a"].process.pid

    def stop() -> None:
        os.kill(replica, signal.SIGSTOP)
        time.sleep(1.5)
        os.kill(replica, signal.SIGCONT)

    # In the pause Prometheus reads it: it asks once a second, and waits for a second.
    with again_and_again(stop, 1.0) as end, cluster.firing("VibroimpactEventLoopLag"):
        end()


@SECOND
def test_a_certificate_that_expires(cluster: Cluster) -> None:
    """Processes that are connected go on; what counts is what the next ones would read."""
    present = Path(cluster.settings["tls_cert"])
    good = present.read_bytes()
    present.write_bytes(certificates.write(cluster.folder / "soon", days=10)[1].read_bytes())
    with cluster.firing("VibroimpactCertificateExpires"):
        present.write_bytes(good)


@SECOND
def test_cold_kernels(cluster: Cluster) -> None:
    """Somebody else has begun to compile the kernels of a kind, and stands still."""
    compiled = cache.folder()
    assert compiled is not None
    copied = cluster.folder / "kernels" / compiled.name
    # Files of these names are being written by another process, and vanish.
    passing = shutil.ignore_patterns("*.tmp.*")
    shutil.copytree(compiled, copied, ignore=passing)
    for step in warming.STEPS:
        warming.note_done(copied, step)
    warming.mark_file(copied, "resonances").unlink()
    cluster.replicas["b"].end()
    with warming.lock_file(copied, "resonances").open("a") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        kept = {"NUMBA_CACHE_DIR": str(copied.parent), "WARMS": "1"}
        cluster.replicas["b"] = cluster.start_replica("b", **kept)
        with cluster.firing("VibroimpactKernelsCold"):
            warming.note_done(copied, "resonances")  # it is done: nothing is left to compile
            fcntl.flock(other, fcntl.LOCK_UN)


@SECOND
def test_no_replica_at_all(cluster: Cluster) -> None:
    for replica in cluster.replicas.values():
        replica.kill()
    with cluster.firing("VibroimpactNoReplica", "VibroimpactReplicaDown"):
        cluster.replicas = {name: cluster.start_replica(name) for name in cluster.replicas}


def test_all_alerts_are_made_to_fire() -> None:
    """Each alert has its fault here, beside its series below."""
    faults = re.findall(r"firing\(([^)]*)\)", Path(__file__).read_text())
    made = {name for fault in faults for name in re.findall(r'"(Vibroimpact\w+)"', fault)}
    assert made == set(CASES)


def test_prometheus_accepts_the_files(tmp_path: Path) -> None:
    for what, name in (("config", "prometheus.yaml"), ("rules", "alerts.yaml")):
        command = [of_prometheus("promtool"), "check", what, str(FOLDER / name)]
        checked = subprocess.run(command, capture_output=True, text=True, check=False)
        assert checked.returncode == 0, checked.stderr


_WRITES = 'vibroimpact_records_transaction_seconds_bucket{{operation="write",le="{}"}}'
_LAG = 'vibroimpact_event_loop_lag_seconds_bucket{{le="{}"}}'
CASES: dict[str, dict[str, str]] = {
    "VibroimpactReplicaDown": {'up{job="vibroimpact",instance="a"}': "1x20 0x40"},
    "VibroimpactNoReplica": {'up{job="vibroimpact",instance="a"}': "1x20 0x40"},
    "VibroimpactNotReady": {'vibroimpact_ready{instance="a"}': "1x20 0x40"},
    "VibroimpactDatabaseFailing": {'vibroimpact_check_ok{part="records"}': "1x20 0x40"},
    "VibroimpactStoreFailing": {'vibroimpact_check_ok{part="store"}': "1x20 0x40"},
    "VibroimpactNoWorkers": {"vibroimpact_worker_slots": "4x20 0x40"},
    "VibroimpactQueueOld": {'vibroimpact_queue_oldest_seconds{kind="k"}': "3600x20 3660+60x40"},
    "VibroimpactWorkerDeaths": {
        # Deaths that the service wants, and some others, do not count.
        'vibroimpact_worker_deaths_total{cause="stopped",instance="a"}': "0+10x60",
        'vibroimpact_worker_deaths_total{cause="killed",instance="a"}': "0x10 1x10 1+1x40",
        'vibroimpact_worker_deaths_total{cause="killed",instance="b"}': "0x10 1x10 1+1x40",
    },
    "VibroimpactClaimsExpired": {
        'vibroimpact_attempts_ended_total{cause="claim_lost"}': "0+1x60",
        'vibroimpact_attempts_ended_total{cause="claim_expired"}': "0x45 1x15",
    },
    "VibroimpactJobsFailing": {
        'vibroimpact_jobs_finished_total{kind="k",state="failed",code="limit_passed"}': "0+1x60",
        'vibroimpact_jobs_finished_total{kind="k",state="failed",code="worker_lost"}': "0x45 1x15",
    },
    "VibroimpactServerErrors": {
        'vibroimpact_http_requests_total{route="/v1/jobs",status="200"}': "0+100x60",
        'vibroimpact_http_requests_total{route="/v1/health/ready",status="503"}': "0+100x60",
        'vibroimpact_http_requests_total{route="/v1/jobs",status="503"}': "0x20 0+10x40",
    },
    "VibroimpactStoreNearlyFull": {
        "vibroimpact_store_capacity_bytes": "100x60",
        "vibroimpact_store_free_bytes": "11x20 9x40",
    },
    "VibroimpactDatabaseSlow": {
        _WRITES.format("0.5"): "0+10x20 200x40",
        _WRITES.format("1.0"): "0+10x60",
        _WRITES.format("+Inf"): "0+10x60",
    },
    "VibroimpactWebhookFailures": {
        'vibroimpact_webhook_deliveries_total{outcome="delivered"}': "0+2x60",
        'vibroimpact_webhook_deliveries_total{outcome="failed"}': "0+1x20 20+9x40",
    },
    "VibroimpactKernelsCold": {'vibroimpact_kernels_warm{kind="k"}': "1x20 0x40"},
    "VibroimpactEventLoopLag": {
        _LAG.format("0.25"): "0+10x20 200x40",
        _LAG.format("0.5"): "0+10x60",
        _LAG.format("+Inf"): "0+10x60",
    },
    "VibroimpactCertificateExpires": {
        # Fourteen days, and twenty minutes: the clock of these tests begins at 0.
        'vibroimpact_certificate_expiry_timestamp_seconds{file="ca"}': f"{14 * 86400 + 1260}x60"
    },
}
"""Alert -> series, a value each minute, by which it fires in the last forty minutes of an hour."""


def test_each_alert_fires_by_its_series_and_not_before(tmp_path: Path) -> None:
    alerts = yaml.safe_load((FOLDER / "alerts.yaml").read_text())["groups"][0]["rules"]
    assert set(CASES) == {each["alert"] for each in alerts}
    cases = []
    for alert, series in CASES.items():
        firing = f'sum(max by (alertname) (ALERTS{{alertname="{alert}",alertstate="firing"}}))'
        cases.append(
            {
                "interval": "1m",
                "name": alert,
                "input_series": [{"series": s, "values": v} for s, v in series.items()],
                "promql_expr_test": [
                    {"expr": firing, "eval_time": "20m", "exp_samples": []},
                    {
                        "expr": firing,
                        "eval_time": "59m",
                        "exp_samples": [{"labels": "{}", "value": 1}],
                    },
                ],
            }
        )
    waiting = {each["alert"]: each["for"] for each in alerts if "for" in each}
    assert waiting
    assert WINDOW not in waiting.values()
    file = tmp_path / "cases.yaml"
    content = {"rule_files": [str(FOLDER / "alerts.yaml")], "tests": cases}
    file.write_text(yaml.safe_dump(content))
    command = [of_prometheus("promtool"), "test", "rules", str(file)]
    tested = subprocess.run(command, capture_output=True, text=True, check=False)
    assert tested.returncode == 0, tested.stdout + tested.stderr
