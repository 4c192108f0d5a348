"""Runs in Debian's Python, beside its Siconos: a request in, one line of JSON for each run out.

It imports nothing of this project. ``--version`` prints the version of the package.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from typing import Any

import numpy as np
import siconos.kernel as sk


def structure(request: dict[str, Any]) -> tuple[Any, Any, list[Any]]:
    """Return the structure, what holds it, and its contacts.

    A load a cos(w t + p) is the displacement of an undamped mass beside the structure.
    """
    n, loads = len(request["K"]), request["loads"]
    size = n + len(loads)
    K, C = np.zeros((size, size)), np.zeros((size, size))
    K[:n, :n] = request["K"]
    if request["C"] is not None:
        C[:n, :n] = request["C"]
    x, v = np.zeros(size), np.zeros(size)
    x[:n], v[:n] = request["state"][:n], request["state"][n:]
    for i, (dof, amplitude, frequency, phase) in enumerate(loads):
        K[n + i, n + i] = frequency**2
        K[dof, n + i] = -1.0
        x[n + i] = amplitude * math.cos(phase)
        v[n + i] = -amplitude * frequency * math.sin(phase)
    body = sk.LagrangianLinearTIDS(x, v, np.eye(size), K, C)
    if request["force"] is not None:
        body.setFExtPtr(np.concatenate([request["force"], np.zeros(len(loads))]))
    model = sk.NonSmoothDynamicalSystem(0.0, 2.0 * request["t_end"])
    model.insertDynamicalSystem(body)
    contacts = []
    for dof, side, gap, restitution in request["walls"]:
        row = np.zeros((1, size))
        row[0, dof] = -side
        relation = sk.LagrangianLinearTIR(row, np.array([gap]))
        contacts.append(sk.Interaction(sk.NewtonImpactNSL(restitution), relation))
        model.link(contacts[-1], body)
    return model, body, contacts


def stepped(request: dict[str, Any], h: float) -> dict[str, Any]:
    """Follow a motion by the time stepping of Moreau and Jean."""
    t_end = request["t_end"]
    steps = max(1, round(t_end / h))
    h = t_end / steps
    model, body, contacts = structure(request)
    clock = sk.TimeDiscretisation(0.0, h)
    simulation = sk.TimeStepping(model, clock, sk.MoreauJeanOSI(0.5), sk.LCP())
    touching = [False] * len(contacts)
    times: list[float] = []
    start = time.process_time()
    for step in range(1, steps + 1):
        simulation.computeOneStep()
        for i, contact in enumerate(contacts):
            touches = contact.lambda_(1)[0] > 0.0
            # A contact that goes on is one impact, or rest.
            if touches and not touching[i]:
                times.append(step * h)
            touching[i] = touches
        simulation.nextStep()
        if step == 1000 and (time.process_time() - start) * steps / step > request["cap"]:
            return {}
    seconds = time.process_time() - start
    return told(request, body, times, seconds, "")


def driven(request: dict[str, Any], tolerance: float) -> dict[str, Any]:
    """Follow a motion from event to event, by LSODAR."""
    t_end = request["t_end"]
    model, body, _ = structure(request)
    integrator = sk.LsodarOSI()
    simulation = sk.EventDriven(model, sk.TimeDiscretisation(0.0, t_end / 4.0))
    simulation.insertIntegrator(integrator)
    simulation.insertNonSmoothProblem(sk.LCP(), sk.SICONOS_OSNSP_ED_IMPACT)
    simulation.insertNonSmoothProblem(sk.LCP(), sk.SICONOS_OSNSP_ED_SMOOTH_ACC)
    simulation.setPrintStat(False)
    simulation.initialize()
    integrator.setTol(1, tolerance, tolerance * 1e-2)
    times: list[float] = []
    end, impact, events = "", 2, simulation.eventsManager()
    start = time.process_time()
    while simulation.hasNextEvent():
        simulation.advanceToEvent()
        now = simulation.nextTime()
        if events.nextEvent().getType() == impact or simulation.istate() == 3:
            if (times and now <= times[-1]) or len(times) >= request["most"]:
                end = "stalls"
                break
            times.append(now)
        simulation.processEvents()
        if simulation.startingTime() >= t_end * (1.0 - 1e-13):
            break
        if time.process_time() - start > request["cap"]:
            return {}
    seconds = time.process_time() - start
    return told(request, body, times, seconds, end)


def told(
    request: dict[str, Any], body: Any, times: list[float], seconds: float, end: str
) -> dict[str, Any]:
    """Return what is told of a run."""
    n = len(request["K"])
    state = np.concatenate([body.q()[:n], body.velocity()[:n]]).tolist()
    return {"times": times, "state": state, "seconds": seconds, "end": end}


def main() -> None:
    """Answer one request."""
    if "--version" in sys.argv:
        query = ["dpkg-query", "-W", "-f", "${Version}", "python3-siconos"]
        done = subprocess.run(query, capture_output=True, text=True, check=False)
        print(done.stdout.partition("-")[0] or "of unknown version")
        return
    request = json.load(sys.stdin)
    run = stepped if request["stepping"] else driven
    for setting in request["settings"]:
        try:
            outcome = run(request, setting)
            if outcome and outcome["seconds"] < 0.3:  # else the first run is as warm as the second
                outcome = run(request, setting)
        except Exception as error:  # what Siconos throws, of whatever kind
            outcome = {
                "times": [],
                "state": request["state"],
                "seconds": 0.0,
                "end": f"throws {error}",
            }
        if not outcome:
            return
        print(json.dumps({"setting": setting, **outcome}), flush=True)


if __name__ == "__main__":
    main()
