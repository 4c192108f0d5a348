"""A reduced model, what it leaves out, and its comparison with the whole one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vibroimpact import grids
from vibroimpact.models.comparison import Comparison, compared
from vibroimpact.models.model import Model
from vibroimpact.models.reduced_model import ReducedModel
from vibroimpact.models.whole_system import Side, base_displacements
from vibroimpact.sensitivity import Sensitivity
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from vibroimpact import documents
    from vibroimpact.client import Client
    from vibroimpact.local import Local
    from vibroimpact.results import Result


@dataclass(frozen=True, eq=False, repr=False)
class Reduction:
    """A reduced model and what it leaves out.

    Natural frequencies converge as modes are added. **The impulses of rigid stops do not**, nor do
    existence bands: a rigid stop excites every mode of the model, and each one that is added
    changes the answer, by a finer mesh as by a larger reduction. `compute` says by how much: it
    repeats a computation with half of the modes. `compare` sets responses at the stops beside those
    of the whole model.

    Parameters
    ----------
    model : ReducedModel
        The reduced model; kept degrees of freedom keep their labels, modes are ``(j, "mode")``,
        motions of rigid bodies with the kept ones at rest before elastic ones.
    T : array, shape (dof, reduced dof)
        Displacements of the whole model by those of the reduced one.
    Omega : array, shape (mode,)
        Natural frequencies of the reduced model that were compared; those of rigid bodies are 0.
    error : array, shape (mode,)
        Upper bounds of their distances from the nearest natural frequency of the whole model,
        relative to that one: ``|Omega^2/lambda - 1| <= |K x - Omega^2 M x| / |x|``, the first
        norm that of K^-1 (of the flexibility beside rigid bodies' motions where K is singular),
        the second that of K; roundings are left out. 0 of rigid bodies, whose motions the reduced
        model has exactly. nan if K is not positive semidefinite, where no such bound holds.
    kept : int
        How many of the degrees of freedom are kept ones; they come first.
    rigid : int
        How many of the modes are motions of rigid bodies; they come first of the modes.
    whole : Model, optional
        The whole model.
    motions : array, shape (reduced dof, rigid)
        Motions of rigid bodies of the whole structure, whether or not they move the kept ones.
    """

    model: ReducedModel
    T: Array
    Omega: Array
    error: Array
    kept: int = 0
    rigid: int = 0
    whole: Model | None = None
    motions: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __repr__(self) -> str:
        """Return its size, and the largest error of its natural frequencies."""
        error = f"; errors up to {self.error.max():.1e}" if self.error.size else ""
        parts = f"{self.kept} kept, {self.rigid} rigid and {self.modes} elastic modes"
        return (
            f"<Reduction: {self.T.shape[0]} degrees of freedom to {self.model.n}: {parts}{error}>"
        )

    def expand(self, q: Array) -> Array:
        """Return displacements of the whole model, shape (..., dof)."""
        return np.asarray(q) @ self.T.T

    @property
    def modes(self) -> int:
        """Number of elastic modes."""
        return self.model.n - self.kept - self.rigid

    def half(self) -> Reduction:
        """Return the reduction with the lower half of the elastic modes; nothing is compared."""
        n = self.kept + self.rigid + self.modes // 2
        none = np.zeros(0)
        part = self.model.part(range(n))
        M = part.M.toarray()
        base = {
            each: base_displacements(M, (self.model.M @ moved)[:n])
            for each, moved in self.model.base.items()
        }
        part = replace(part, base=base)
        motions = self.motions[:n]
        return Reduction(
            part, self.T[:, :n], none, none, self.kept, self.rigid, self.whole, motions
        )

    def compute(self, computation: Callable[[ReducedModel], Result]) -> Result:
        """Return a result of the reduced model that says how much it owes to the modes.

        Parameters
        ----------
        computation : callable
            Returns the result of a model, such as ``lambda model: client.impact_modes(
            model.system([model.constraint(17, "z", 1e-3)]), [40.0])``. It is called for the
            reduced model, and for that with half of the elastic modes, which is the smaller task.

        Returns
        -------
        Result
            That of the reduced model, with `Result.sensitivity`.

        Raises
        ------
        ValueError
            If there are no elastic modes to leave out.
        """
        if self.modes < 1:
            raise ValueError("a reduction without elastic modes has none to leave out")
        result = computation(self.model)
        smaller = computation(self.half().model)
        result.sensitivity = Sensitivity.between(
            result, smaller, self.modes, self.modes // 2, self.kept
        )
        return result

    def compare(
        self,
        structure: documents.MatrixSystem,
        frequency: Any = None,
        load: Sequence[documents.DriveTerm] = (),
        *,
        unit: str = "Omega",
        at: float | None = None,
        client: Client | Local | None = None,
        **options: Any,
    ) -> Comparison:
        """Compare with the whole model at the stops: harmonic, static, and one driven motion.

        Arguments are those of `Client.periodic_motions`. The responses of the whole model are
        solved by one factor of its stiffness, to a residual that is stated.

        Parameters
        ----------
        structure : dict
            From ``small.model.system(stops, damping=…)``: its stops, damping, dashpots and
            influence are taken to the whole model. Ratios damp the same motions there, the modes of
            the reduced model.
        frequency : array, (start, stop, num) or dict, optional
            Frequencies of the receptances, not 0; default: 100, up to the highest natural
            frequency that was compared.
        load : sequence of dict
            Terms from `drive`, whose unit forces act too, beside one at each stop.
        unit : str
            Of frequencies: Omega, omega, Hz or rpm.
        at : float, optional
            Frequency at which the periodic motions under `load` are computed as well, with their
            impacts and contacts, of both models. The whole one is taken with all degrees of freedom
            where these are at most 300; else in the subspace of its responses, if all stops have a
            stiffness.
        client : Client or Local, optional
            Computes these motions; default: `Local`.
        **options
            Of `periodic_motions`: sequence, constraint, periods, phases, tolerance.

        Raises
        ------
        ValueError
            If the structure is not of the reduced model, a stop, load or dashpot acts on a mode,
            a frequency is 0 or an undamped resonance, the stiffness is not positive semidefinite,
            or the whole model with rigid stops is too large for motions.
        """
        if self.whole is None:
            raise ValueError("the reduction does not have its whole model")
        if options and at is None:
            raise ValueError(f"{', '.join(options)}: only motions take it, at a frequency at=")
        rows = [self.whole.dof(*label) for label in self.model.labels[: self.kept]]
        place = np.array(rows, dtype=np.int64)
        side = Side(self.whole, self.model, self.T, place, structure)
        if frequency is None:
            time = (self.model.units or {}).get("time", "s")
            highest = float(self.Omega.max(initial=0.0)) / grids.angular(unit, time)
            if highest == 0.0:
                raise ValueError("frequency: no natural frequency was compared that could end it")
            given = highest * np.arange(1, 101) / 100
        else:
            given = grids.values(frequency, "frequency")
        first = self.kept + self.rigid
        return compared(side, first, self.motions, given, load, unit, at, client, options)
