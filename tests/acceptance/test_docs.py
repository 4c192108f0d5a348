"""What the documentation shows runs, and its numbers are those of an independent computation."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import scipy.linalg

from tests.acceptance.conftest import Service

mpl.use("Agg")
ROOT = Path(__file__).parents[2]


def _blocks(page: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```$", (ROOT / page).read_text(), re.M | re.S)


def _run(page: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    for block in _blocks(page):
        exec(compile(block, page, "exec"), names)
    names["client"].close()
    return names


@pytest.fixture(autouse=True)
def at(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let clients find the service that is there."""
    monkeypatch.setenv("VIBROIMPACT_URL", service.url)


def test_the_readme() -> None:
    assert _run("README.md")["result"].impulse.shape == (1000, 1)


def test_the_beam_of_the_structures_page() -> None:
    """The impulse is that of the structure's answer to a train of impulses.

    Between kicks -J at t = 0 and J at T/2 a mode of rate w, which is odd about T/4, moves as
    b sin(w (t - T/4)); its velocity jumps by 2 b w cos(w T/4) = -J. Hence it is at
    ``J tan(w T/4) / (2 w)`` as the upper stop is struck, and p = J Omega / pi.
    """
    names = _run("docs/structures.md")
    family, gap = names["family"], 1e-3
    squares, Phi = scipy.linalg.eigh(names["K"], names["M"])
    w, at_tip = np.sqrt(squares), Phi[names["tip"]] ** 2
    for place in (3, 57, 211):
        Omega = family.Omega[place]
        per_kick = np.sum(at_tip * np.tan(w * np.pi / (2 * Omega)) / (2 * w))
        p = gap / per_kick * Omega / np.pi
        # Rates of a dense eigenproblem are uncertain by 1e-16 of the square of the highest.
        assert family.impulse[place, 0] == pytest.approx(p, rel=1e-6)
    bands = names["bands"].bands
    assert np.all(bands.certified == "yes")
    assert bands.start.size > 3
    assert names["motion"].x.shape == (2000, 1)
    assert np.all(np.abs(names["motion"].x) <= gap * (1 + 1e-9))
