"""Results that move, in notebooks: the drawing of the console as a widget.

``pip install "vibroimpact[notebook]"`` brings anywidget, which shows it in Jupyter, VS Code,
Colab and marimo, without a network.
"""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibroimpact.result_file import ResultFile
from vibroimpact.tables import Array

_MODULES: Final = ("numbers.js", "player.js", "envelope.js", "walls.js", "shape.js", "notebook.js")
_MOST_MOTIONS: Final = 50
_MOST_COORDINATES: Final = 400


def show(result: ResultFile) -> Any:
    """Return a widget in which the structure of a result moves between its stops.

    Impact modes and periodic motions need the output waveform, time histories x.

    Raises
    ------
    ValueError
        If the result has no displacements over time, or leaves out constrained coordinates.
    ImportError
        If anywidget is not installed.
    """
    scene_of_result = scene(result)
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise ImportError('result.show() needs: pip install "vibroimpact[notebook]"') from error

    class Moving(anywidget.AnyWidget):  # type: ignore[misc]
        _esm = module()
        scene = traitlets.Dict().tag(sync=True)

    return Moving(scene=scene_of_result)


def scene(result: ResultFile) -> dict[str, Any]:
    """Return what is drawn: geometry, stops, and the displacements of each motion.

    Raises
    ------
    ValueError
        If there are no displacements over a whole period.
    """
    motions = _motions(result)
    if not motions:
        raise ValueError(
            f"a result of {result.kind} moves if it has displacements over time: "
            "ask for the output waveform with tau, or x with t"
        )
    system = result.request.get("system", {})
    # The widget draws the computed coordinates only: they are numbered anew.
    place = {int(dof): index for index, dof in enumerate(result.dof)}
    if len(place) > _MOST_COORDINATES:
        raise ValueError(f"choose at most {_MOST_COORDINATES} coordinates by dofs")
    ends = [system.get("preset") in {"chain", "two_mass"}] * 2
    row = len(place) <= 3 and system.get("preset") in {"oscillator", "two_mass", "chain"}
    geometry = {
        "layout": "row" if row else "profile",
        "n": len(place),
        "drawn": list(range(len(place))),
        "fixed": [True, False] if system.get("preset") == "oscillator" else ends,
        "springs": True,
        "smooth": False,
    }
    return {
        "geometry": geometry,
        "stops": [_stop(each, place) for each in system.get("constraints", []) if _at(each, place)],
        "motions": motions,
        "again": result.kind != "time-history",
        "seconds": 12.0 if result.kind == "time-history" else 3.0,
    }


def module() -> str:
    """Return the drawing of the console as one ES module."""
    # One package has both; what else the service needs may be missing, so that it is not imported.
    spec = find_spec("vibroimpact_service")
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent / "console"
    source = "\n".join((folder / name).read_text(encoding="utf-8") for name in _MODULES)
    return re.sub(r'^import .* from "\./.*";$', "", source, flags=re.MULTILINE)


def _motions(result: ResultFile) -> list[dict[str, Any]]:
    if result.kind == "time-history" and hasattr(result, "x"):
        return [_motion("time history", result.x, mirrored=False)]
    if not hasattr(result, "waveform"):
        return []
    if result.kind == "impact-modes":
        if result.tau.min() >= 0.0 and not _equal_gaps(result.request["system"]):
            raise ValueError("modes between unequal gaps need tau from -1 to 1")
        return [
            _motion(f"Ω = {Omega:.6g}", _period(result.tau, waveform), mirrored=True)
            for Omega, waveform in zip(result.Omega, result.waveform, strict=True)
        ][:_MOST_MOTIONS]
    rows = result.solution
    return [
        _motion(f"Ω = {Omega:.6g}, {count} impacts", waveform, mirrored=False)
        for Omega, count, waveform in zip(rows.Omega, rows.impacts, result.waveform, strict=True)
    ][:_MOST_MOTIONS]


def _equal_gaps(system: dict[str, Any]) -> bool:
    gaps = [each["gap"] for each in system.get("constraints", [])]
    return all(not isinstance(gap, dict) or gap.get("lower") == gap.get("upper") for gap in gaps)


def _motion(title: str, rows: Array, *, mirrored: bool) -> dict[str, Any]:
    return {"title": title, "rows": np.asarray(rows).tolist(), "mirrored": mirrored}


def _period(tau: Array, waveform: Array) -> Array:
    """Return displacements at equally spaced tau from -1 to 1; modes between equal gaps are odd."""
    order = np.argsort(tau)
    tau, waveform = tau[order], waveform[order]
    if tau[0] >= 0.0:
        later = tau > 0.0
        tau = np.concatenate([-tau[later][::-1], tau])
        waveform = np.concatenate([-waveform[later][::-1], waveform])
    equal = np.linspace(-1.0, 1.0, 2 * tau.size + 1)
    columns = [np.interp(equal, tau, column) for column in waveform.T]
    return np.stack(columns, axis=1)


def _dofs(constraint: dict[str, Any]) -> list[int]:
    if constraint.get("dof") is not None:
        return [int(constraint["dof"])]
    return [int(dof) for dof in constraint["direction"]["dofs"]]


def _at(constraint: dict[str, Any], place: dict[int, int]) -> bool:
    return all(dof in place for dof in _dofs(constraint))


def _stop(constraint: dict[str, Any], place: dict[int, int]) -> dict[str, Any]:
    gap = constraint["gap"]
    limits = gap if isinstance(gap, dict) else {"lower": gap, "upper": gap}
    dof, *others = (place[each] for each in _dofs(constraint))
    return {
        "dof": dof,
        "relativeTo": others[0] if others else None,
        "lower": limits.get("lower"),
        "upper": limits.get("upper"),
    }
