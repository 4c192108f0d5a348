"""Users of a service whose processes are killed: they submit jobs, and check the results."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import httpx2
import numpy as np
from processes import SLOW, Replica, until

from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service.documents import decode, sweep_axes
from vibroimpact_solvers import impact_modes
from vibroimpact_solvers import sweep as solver

RETRIED = (httpx2.TransportError, httpx2.HTTPStatusError)
"""Failures after which a client repeats its request."""


def sweep(start: float, num: int = 40_000) -> dict[str, Any]:
    """Return a request that is cut into some fifty chunks, and is no quick job."""
    return {
        "system": {"preset": "chain", "n": 40, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": start, "stop": 2.4, "num": num},
        "outputs": ["impulse", "exists"],
    }


def tiny(start: float) -> dict[str, Any]:
    """Return a request that is one chunk."""
    return sweep(start, 20)


def history(t_end: float = 4000.0) -> dict[str, Any]:
    """Return a request whose chunks follow one another."""
    return {
        "system": {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]},
        "initial": {"x": [0.1 * (-1) ** i for i in range(13)], "v": [0.3] * 13},
        "t_end": t_end,
        "t": {"num": 200},
        "outputs": ["x"],
    }


def continued() -> dict[str, Any]:
    """Return a sweep whose points follow one another along the first axis, in eight chains."""
    base = history(400.0) | {"outputs": ["x", "v"], "t": [400.0]}
    base["load"] = [{"dof": 2, "amplitude": 0.1, "frequency": 1.1}]
    stiffness = [1.0 + k / 20 for k in range(8)]
    return {
        "kind": "time-history",
        "base": base,
        "axes": [
            {"path": "load.0.amplitude", "start": 0.3, "stop": 0.1, "num": 5},
            {"path": "system.stiffness", "values": stiffness},
        ],
        "continue": True,
    }


def uninterrupted(content: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Return the displacements of a sweep that the solver computes in this process."""
    request = SweepRequest.model_validate(content)
    problem = sweep_axes.problem(request, decode.system(request.system), lambda: None)
    return solver.solve(problem, solver.plan(problem)).arrays["x"]


def impulses(content: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Return the impulses that the solver computes in this process."""
    request = ImpactModesRequest.model_validate(content)
    problem = decode.impact_modes(request, decode.system(request.system))
    impulse = impact_modes.solve(problem, impact_modes.plan(problem)).impulse
    assert impulse is not None
    return impulse


@dataclass
class User:
    """Submits jobs under idempotency keys, to whichever replica answers, until each is accepted."""

    replicas: list[Replica]
    accepted: dict[str, tuple[str, dict[str, Any]]] = field(default_factory=dict)
    kind: str = "impact-modes"

    def ask(self, method: str, path: str, **arguments: Any) -> Any:
        """Repeat a request until it is answered, and return the answer."""
        end = time.monotonic() + SLOW
        while time.monotonic() < end:
            for replica in self.replicas:
                try:
                    answer = replica.http.request(method, path, **arguments)
                    if answer.status_code in (502, 503, 504, 507):
                        answer.raise_for_status()
                except RETRIED as error:
                    last = error
                    time.sleep(0.1)
                else:
                    return answer
        raise last

    def submit(self, *contents: dict[str, Any]) -> None:
        """Submit jobs."""
        for content in contents:
            key = f"key-{len(self.accepted)}"
            body = {"kind": self.kind, "request": content}
            answer = self.ask("POST", "/v1/jobs", json=body, headers={"Idempotency-Key": key})
            assert answer.status_code == 201, answer.text
            self.accepted[key] = (answer.json()["id"], content)

    def check(self, *others: str) -> None:
        """Check that every accepted job ends well, with the right numbers, and is there once.

        Others may be there as well.
        """
        for key, (job, content) in self.accepted.items():
            done = until(lambda job=job: self.final(job), f"{job} does not end")
            assert done["state"] == "succeeded", done
            assert done["progress"]["done"] == done["progress"]["total"]
            answer = self.ask("GET", done["result"])
            np.testing.assert_array_equal(np.array(answer.json()["impulse"]), impulses(content))
            body = {"kind": "impact-modes", "request": content}
            again = self.ask("POST", "/v1/jobs", json=body, headers={"Idempotency-Key": key})
            assert again.json()["id"] == job
        listed = [job["id"] for job in self.ask("GET", "/v1/jobs?limit=500").json()["jobs"]]
        assert sorted(listed) == sorted([*others, *(job for job, _ in self.accepted.values())])

    def final(self, job: str) -> dict[str, Any] | None:
        """Return a job that has ended, or None."""
        document: dict[str, Any] = self.ask("GET", f"/v1/jobs/{job}?wait=5").json()
        return document if document["final"] else None
