"""Functions that return request documents, of every kind of computation.

Each takes what the method of the same name of `Client` takes, and returns what that method sends.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from vibroimpact.computations import Computations

if TYPE_CHECKING:
    from vibroimpact import documents  # noqa: F401


class _Requests(
    Computations[
        "documents.NaturalFrequenciesRequest",
        "documents.ImpactModesRequest",
        "documents.ExistenceBandsRequest",
        "documents.ResonancesRequest",
        "documents.PeriodicMotionsRequest",
        "documents.BranchesRequest",
        "documents.AttractorsRequest",
        "documents.TimeHistoryRequest",
        "documents.EnsembleRequest",
        "documents.SlowFlowRequest",
        "documents.CalibrationRequest",
        "documents.SweepRequest",
    ]
):
    def _compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Any:
        return dict(request)


REQUESTS: Final = _Requests()
"""Its methods return the request documents that the same methods of the clients send."""

natural_frequencies_request = REQUESTS.natural_frequencies
"""Return the request document that `Client.natural_frequencies` sends."""
impact_modes_request = REQUESTS.impact_modes
"""Return the request document that `Client.impact_modes` sends."""
existence_bands_request = REQUESTS.existence_bands
"""Return the request document that `Client.existence_bands` sends."""
resonances_request = REQUESTS.resonances
"""Return the request document that `Client.resonances` sends."""
periodic_motions_request = REQUESTS.periodic_motions
"""Return the request document that `Client.periodic_motions` sends."""
branches_request = REQUESTS.branches
"""Return the request document that `Client.branches` sends."""
attractors_request = REQUESTS.attractors
"""Return the request document that `Client.attractors` sends."""
time_history_request = REQUESTS.time_history
"""Return the request document that `Client.time_history` sends."""
ensemble_request = REQUESTS.ensemble
"""Return the request document that `Client.ensemble` sends."""
slow_flow_request = REQUESTS.slow_flow
"""Return the request document that `Client.slow_flow` sends."""
calibration_request = REQUESTS.calibration
"""Return the request document that `Client.calibration` sends."""
sweep_request = REQUESTS.sweep
"""Return the request document that `Client.sweep` sends."""
