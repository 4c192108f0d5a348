"""Damping of documents: ratios, Rayleigh's, structural, and dashpots."""

from __future__ import annotations

from vibroimpact_schema import systems
from vibroimpact_service.documents.grid_values import to_fundamental
from vibroimpact_solvers import damping
from vibroimpact_solvers.model import System, Units


def damped(document: systems.AnySystem, system: System) -> System:
    """Return a system with the damping of its document, beside C and what presets have.

    Raises
    ------
    ModelError
        With the pointer inside the document.
    """
    law = None if document.damping is None else _law(document.damping, system.units)
    dashpots = [
        damping.Dashpot(tuple(each.dofs), tuple(each.weights), each.c)
        for each in document.dashpots or ()
    ]
    return damping.damped(system, law, dashpots)


def remark(law: systems.StructuralDamping) -> tuple[str, str]:
    """Return what structural damping stands for, and why, for plans."""
    why = (
        f"structural damping is taken as viscous, C = (eta/Omega) K, which loses as much at "
        f"{law.at!r} {law.unit}, more above and less below"
    )
    return "losses that do not depend on the frequency", why


def _law(document: systems.Damping, units: Units | None) -> damping.Law:
    match document:
        case systems.RatioDamping(ratio=list() as each):
            return damping.Ratio(tuple(each))
        case systems.RatioDamping(ratio=one):
            assert isinstance(one, float)
            return damping.Ratio((one,))
        case systems.StructuralDamping():
            factor = to_fundamental(document.unit, units, ("damping", "unit"))
            return damping.Structural(document.structural, document.at * factor)
        case systems.RayleighDamping(rayleigh=systems.RayleighRatios() as given):
            factor = to_fundamental(given.unit, units, ("damping", "rayleigh", "unit"))
            return damping.Rayleigh.through(given.ratios, [at * factor for at in given.at])
        case systems.RayleighDamping(rayleigh=list() as coefficients):
            return damping.Rayleigh(*coefficients)
    raise AssertionError(document)
