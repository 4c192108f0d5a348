"""Random motions between soft limiters."""

from __future__ import annotations

import numpy as np
from flint import arb

from tests.reference.balls import UndecidedError
from tests.reference.rigid import History
from tests.reference.soft import SoftMotion, Spring
from tests.truth import histories, structures
from tests.truth.verdicts import Case, Report
from vibroimpact_solvers import time_history

MAKERS = ("plain", "damped", "coupled", "loaded", "free")


def case(rng: np.random.Generator) -> Case:
    """Return a random motion."""
    name = str(rng.choice(MAKERS))
    document = histories.MAKERS[name](rng)
    fast = histories.top_frequency(document)
    stiffness = 10.0 ** rng.uniform(-1, 2) * fast**2 * float(np.diag(document["M"]).mean())
    document["limiter"] = {
        "exponent": int(rng.choice([1, 2, 3, 5, 7, 17])),
        "stiffness": float(stiffness),
        "scale": float(rng.choice([1.0, rng.uniform(0.5, 2.0)])),
    }
    T = float(10.0 ** rng.uniform(0.0, 1.2)) * 2.0 / fast
    document["t"] = np.sort(rng.uniform(0.0, T, int(rng.choice([1, 3, 10])))).tolist()
    document["t_end"] = T
    if rng.random() < 0.5:
        document["tolerance"] = float(10.0 ** -rng.uniform(4, 13))
    return Case(f"{name}, power {document['limiter']['exponent']}", document)


def check(case: Case, report: Report) -> None:
    """Compare the motion of a case with its reference."""
    document = case.document
    law = document["limiter"]
    problem = time_history.Problem(
        structures.system(document),
        time_history.State(np.array(document["x"]), np.array(document["v"])),
        document["t_end"],
        t=np.array(document["t"]),
        outputs=frozenset({"x", "v", "energy"}),
        load=tuple(time_history.Harmonic(*term) for term in document.get("load", ())),
        limiter=time_history.Power(float(law["exponent"]), law["stiffness"], law["scale"]),
        tolerance=document.get("tolerance"),
    )
    plan = time_history.plan(problem)
    report.work(plan)
    result = time_history.solve(problem, plan)
    report.phase("reference")
    scale = arb(law["scale"])
    springs = [
        Spring(
            structures.row(document, c),
            None if c["lower"] is None else scale * arb(c["lower"]),
            None if c["upper"] is None else scale * arb(c["upper"]),
            law["stiffness"],
            law["exponent"],
        )
        for c in document["constraints"]
    ]
    for spring, c in zip(springs, document["constraints"], strict=True):
        if c["lower"] == c["upper"]:
            object.__setattr__(spring, "lower", spring.upper)
    try:
        motion = SoftMotion(structures.reference(document), springs, document["x"], document["v"])
        states = motion.run(document["t"])
    except UndecidedError as error:
        report.count(f"undecided: {error}")
        return
    histories.compare_states(case, result, History(states=states), report)
