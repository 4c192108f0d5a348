"""Requests that the benchmarks send: impact modes of a chain, each unlike all others."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

COMPUTE: Final = "/v1/compute/impact-modes"
UNIQUE: Final = "unique"
"""Stands in the content of a request for a number from 0.5 to 0.6 that no other request has."""
_DIGITS: Final = "#######"


@dataclass(frozen=True, slots=True)
class Request:
    """A request to send, once or again and again.

    Parameters
    ----------
    method, path, body : str
    headers : mapping
    """

    method: str
    path: str
    body: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def post(cls, path: str, content: Any) -> Request:
        """Return a request with a JSON body, in which `UNIQUE` may stand for a number."""
        body = json.dumps(content).replace(f'"{UNIQUE}"', f"0.5{_DIGITS}")
        return cls("POST", path, body, {"Content-Type": "application/json"})

    @classmethod
    def job(cls, content: Any) -> Request:
        """Return a request that submits a job for impact modes."""
        return cls.post("/v1/jobs", {"kind": "impact-modes", "request": content})

    def encoded(self, number: int) -> bytes:
        """Return the bytes to send, the digits of `UNIQUE` replaced by a number."""
        body = self.body.replace(_DIGITS, f"{number:07d}").encode()
        fields = {"Host": "localhost", "Content-Length": str(len(body)), **self.headers}
        head = "".join(f"{name}: {value}\r\n" for name, value in fields.items())
        return f"{self.method} {self.path} HTTP/1.1\r\n{head}\r\n".encode() + body


def modes(
    start: float | str = UNIQUE, num: int = 1, n: int = 13, outputs: Sequence[str] = ("impulse",)
) -> dict[str, Any]:
    """Return the content of a request for impact modes at frequencies from `start` on."""
    frequency = {"values": [start]} if num == 1 else {"start": start, "stop": 2.4, "num": num}
    system = {"preset": "chain", "n": n, "constraints": [{"dof": 5, "gap": 0.2}]}
    return {"system": system, "frequency": frequency, "outputs": list(outputs)}
