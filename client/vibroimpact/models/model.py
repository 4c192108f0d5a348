"""A finite-element model: matrices, and the node and direction of every degree of freedom."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from vibroimpact.arguments import unit_names
from vibroimpact.errors import InvalidRequest, MissingExtra
from vibroimpact.local import Local
from vibroimpact.models.motion_files import write_motion
from vibroimpact.systems import constraint, system
from vibroimpact.tables import Array
from vibroimpact_schema.files.labels import DIRECTIONS, Label

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes

    from vibroimpact import documents
    from vibroimpact.systems import Constraints, Damping, Dashpots

try:
    from vibroimpact_schema.files import symmetry
except ImportError as missing:  # scipy
    raise MissingExtra("finite-element models", "models", missing) from missing


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """Mass, stiffness and damping with the labels of their rows.

    Parameters
    ----------
    M, K, C : array or sparse matrix, shape (n, n)
        Mass, stiffness and damping; C may be None. They are kept sparse and symmetric.
    labels : sequence of (int, str), optional
        Node and direction of each degree of freedom, such as ``(17, "z")``; default: its index,
        and ``"x"``.
    coordinates : mapping, optional
        Node -> coordinates, one to three numbers.
    units : mapping, optional
        ``{"length": "m", "mass": "kg", "time": "s"}``.
    rounding : float
        Largest difference of entries (i, j) and (j, i), relative to the largest entry, that is
        taken for rounding: both become their mean. Matrices computed in single precision need
        some 1e-6.
    symmetrize : bool
        Whether a matrix whose difference is larger becomes the mean of both all the same, with a
        warning.
    elements : mapping, optional
        Shape, such as ``"hexahedron"`` or ``"quad"`` -> the nodes of each element, for files of
        motions on the mesh, see `write`.
    base : mapping, optional
        Direction -> displacements by a unit displacement of the base, shape (n,), where labels do
        not tell: in reduced models, whose modes move with the base too, see `influence`.

    Raises
    ------
    ValueError
        If sizes do not fit, a label occurs twice, or a matrix is not symmetric or not real.
    """

    M: Any
    K: Any
    C: Any = None
    labels: Sequence[Label] = ()
    coordinates: Mapping[int, Sequence[float]] = field(default_factory=dict)
    units: Mapping[str, str] | None = None
    rounding: float = symmetry.ROUNDING
    symmetrize: bool = False
    elements: Mapping[str, Sequence[Sequence[int]]] = field(default_factory=dict)
    base: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("M", "K", "C"):
            given = getattr(self, name)
            if given is not None:
                matrix = _symmetric(name, given, self.rounding, self.symmetrize)
                object.__setattr__(self, name, matrix)
        n = self.M.shape[0]
        labels = tuple(self.labels) or tuple((index, "x") for index in range(n))
        if any(part is not None and part.shape[0] != n for part in (self.K, self.C)):
            raise ValueError("M, K and C need the same size")
        if self.units is not None:
            object.__setattr__(self, "units", unit_names(self.units))
        if len(labels) != n or len(set(labels)) != n:
            raise ValueError(f"{n} degrees of freedom need {n} different labels")
        object.__setattr__(self, "labels", labels)

    def __repr__(self) -> str:
        """Return its size and what is known of it."""
        nodes = len({node for node, _ in self.labels})
        directions = ", ".join(dict.fromkeys(each for _, each in self.labels))
        known = [
            f"{self.n} degrees of freedom",
            "counted from 0, without nodes and directions"
            if self.numbered
            else f"{nodes} nodes ({directions})",
        ]
        known += ["with damping"] if self.C is not None else []
        known += [] if self.coordinates else ["no coordinates"]
        known += [" ".join(self.units.values())] if self.units else ["no units"]
        return f"<Model: {'; '.join(known)}>"

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return int(self.M.shape[0])

    @cached_property
    def numbered(self) -> bool:
        """Whether degrees of freedom are only counted, from 0: it has no nodes and directions."""
        numbers = tuple((index, "x") for index in range(self.n))
        return self.labels == numbers and not self.coordinates

    def dof(self, node: int, direction: str = "x") -> int:
        """Return the index of a degree of freedom.

        Raises
        ------
        ValueError
            Naming the directions that the node has.
        """
        try:
            return self._rows[node, direction]
        except KeyError:
            have = [each for at, each in self.labels if at == node]
            known = f"node {node} has {', '.join(have)}" if have else f"there is no node {node}"
            raise ValueError(
                f"no degree of freedom {direction!r} of node {node}: {known}"
            ) from None

    @cached_property
    def _rows(self) -> Mapping[Label, int]:
        """Row of each label."""
        return {label: row for row, label in enumerate(self.labels)}

    @cached_property
    def places(self) -> Array | None:
        """Where each degree of freedom lies, shape (dof, 3); None where a node has no place."""
        if not all(node in self.coordinates for node, _ in self.labels):
            return None
        places = np.zeros((self.n, 3))
        for row, (node, _) in enumerate(self.labels):
            place = self.coordinates[node]
            places[row, : len(place)] = place
        return places

    def constraint(
        self,
        node: int,
        direction: str | Mapping[str, float] = "x",
        gap: float | Mapping[str, float | None] = 0.0,
        restitution: float | None = None,
        *,
        against: int | None = None,
        stiffness: float | None = None,
        damping: float | None = None,
    ) -> documents.Constraint:
        """Return the document of a stop at a node.

        Parameters
        ----------
        node : int
            Label of the node.
        direction : str or mapping
            Such as ``"z"``, or weights of several: ``{"x": 0.6, "y": 0.8}``.
        gap, restitution, stiffness, damping
            As of `vibroimpact.constraint`.
        against : int, optional
            Another node: the stop is between both.
        """
        weights = self.weights(node, direction, against=against)
        one = len(weights) == 1 and 1.0 in weights.values()
        stop = constraint(
            next(iter(weights)) if one else None,
            gap,
            restitution,
            direction=None if one else weights,
            stiffness=stiffness,
            damping=damping,
        )
        return self._placed(stop, node, direction, against)

    def _placed(
        self,
        stop: documents.Constraint,
        node: int,
        direction: str | Mapping[str, float],
        against: int | None,
    ) -> documents.Constraint:
        """Return a stop that knows of its place what its document does not tell: here, nothing."""
        return stop

    def weights(
        self,
        node: int,
        direction: str | Mapping[str, float] = "x",
        *,
        against: int | None = None,
    ) -> dict[int, float]:
        """Return the weights of the degrees of freedom in a displacement of a node.

        They are what `vibroimpact.drive`, `sampled` and `dashpot` take as `dof`. Arguments are
        those of `constraint`.
        """
        parts = {direction: 1.0} if isinstance(direction, str) else dict(direction)
        weights = {self.dof(node, each): float(w) for each, w in parts.items()}
        if against is not None:
            weights |= {self.dof(against, each): -float(w) for each, w in parts.items()}
        return weights

    def system(
        self,
        constraints: Constraints,
        force: Mapping[Label, float] | None = None,
        *,
        damping: Damping | None = None,
        dashpots: Dashpots = (),
        base: str | None = None,
    ) -> documents.MatrixSystem:
        """Return the structure's document; `force` maps labels to static loads.

        `damping` and `dashpots` are as of `vibroimpact.system`, damping instead of the model's C;
        `base` is the direction in which the base moves, such as ``"z"``, see `influence`.
        """
        load = None
        if force is not None:
            load = np.zeros(self.n)
            for (node, direction), value in force.items():
                for dof, weight in self.weights(node, direction).items():
                    load[dof] += weight * value
        given = None if load is None else load.tolist()
        C = self.C if damping is None else None
        influence = None if base is None else self.influence(base)
        return system(
            self.M, self.K, constraints, C, given, self.units,
            damping=damping, dashpots=dashpots, influence=influence,
        )  # fmt: skip

    def influence(self, direction: str) -> Array:
        """Return the displacements by a unit displacement of the base in a direction, (dof,).

        1 for the degrees of freedom in that direction, 0 for others. Of a reduced model, the
        displacements whose inertia forces are those of the whole model, ``M r = T' M_whole r``.

        Raises
        ------
        ValueError
            If there is none in that direction.
        """
        if direction in self.base:
            return np.array(self.base[direction], dtype=np.float64)
        if self.base:
            known = ", ".join(self.base)
            raise ValueError(f"no degree of freedom in direction {direction!r}: there are {known}")
        moved = np.array([1.0 if each == direction else 0.0 for _, each in self.labels])
        if not moved.any():
            known = ", ".join(dict.fromkeys(each for _, each in self.labels))
            raise ValueError(f"no degree of freedom in direction {direction!r}: there are {known}")
        return moved

    def fixed(self, nodes: Iterable[int], directions: Iterable[str] | None = None) -> Self:
        """Return the model with nodes held fixed, in all directions or in some.

        Raises
        ------
        ValueError
            If there is no such node, or none of them has such a direction.
        """
        held, chosen = set(nodes), None if directions is None else set(directions)
        missing = held - {node for node, _ in self.labels}
        if missing:
            few = ", ".join(map(str, sorted(missing)[:10]))
            raise ValueError(f"there are no nodes {few}{'' if len(missing) <= 10 else ', ...'}")
        for each in chosen or ():
            if not any(node in held and own == each for node, own in self.labels):
                raise ValueError(f"none of the nodes has a direction {each!r}")
        keep = [
            index
            for index, (node, direction) in enumerate(self.labels)
            if node not in held or (chosen is not None and direction not in chosen)
        ]
        return self.part(keep)

    def part(self, keep: Sequence[int]) -> Self:
        """Return the model with some of its degrees of freedom, the others held fixed."""
        rows = np.asarray(keep, dtype=np.int64)
        M, K, C = (
            None if part is None else part[rows][:, rows] for part in (self.M, self.K, self.C)
        )
        labels = tuple(self.labels[row] for row in rows)
        base = {each: np.asarray(moved)[rows] for each, moved in self.base.items()}
        return replace(self, M=M, K=K, C=C, labels=labels, base=base)

    def natural(
        self,
        count: int | None = None,
        *,
        unit: str = "Omega",
        stop: float | None = None,
    ) -> Array:
        """Return the lowest natural frequencies, without damping, shape (mode,).

        Shapes and more come from ``Local().natural_frequencies(model.system([]))``.

        Parameters
        ----------
        count : int, optional
            Number of modes; default: 10, or all up to `stop`.
        unit : str
            ``"Omega"`` (angular), ``"Hz"`` or ``"rpm"``, of the result and of `stop`.
        stop : float, optional
            Instead of `count`: the frequency up to which all are returned.

        Raises
        ------
        MissingExtra
            If the solvers are not installed.
        InvalidRequest
            If some motion has no mass, or a negative one.
        """
        try:
            result = Local().natural_frequencies(
                self.system([]), count, stop=stop, unit=unit, outputs=["Omega"]
            )
        except InvalidRequest as refused:
            if "/system/M" in str(refused):
                refused.add_note("vi.reduce takes models in which some motions have no mass")
            raise
        return result.in_unit(result.Omega, unit)

    # -- on the geometry -------------------------------------------------------------------

    def displaced(self, x: Array, scale: float = 1.0) -> tuple[Array, Array]:
        """Return the coordinates of the nodes at rest and displaced, each shape (node, 3).

        Parameters
        ----------
        x : array, shape (dof,)
            Displacements.
        scale : float
            Factor of the displacements.
        """
        nodes = list(self.coordinates)
        places = {node: row for row, node in enumerate(nodes)}
        rest = np.zeros((len(nodes), 3))
        for node, row in places.items():
            rest[row, : len(self.coordinates[node])] = self.coordinates[node]
        moved = rest.copy()
        for (node, direction), value in zip(self.labels, np.asarray(x), strict=True):
            if node in places and direction in DIRECTIONS[:3]:
                moved[places[node], DIRECTIONS.index(direction)] += scale * value
        return rest, moved

    def write(
        self,
        path: str | Path,
        x: Array,
        t: Array | None = None,
        *,
        v: Array | None = None,
    ) -> None:
        """Write a motion on the mesh: for ParaView, or for programs of modal tests.

        ``.vtu`` is one shape, ``.pvd`` a series of them in a folder of its own, ``.xdmf`` a series
        with an ``.h5`` beside; ``.unv`` and ``.uff`` are universal files, data sets 15 and 58.
        Displacements, rotations and velocities are vectors of each node.

        Parameters
        ----------
        path : path
        x : array, shape (dof,) or (time, dof)
            Displacements, such as ``small.expand(motion.x)`` of a reduced model.
        t : array, shape (time,), optional
            Times; default: 0, 1, 2, and so on.
        v : array, optional
            Velocities, of the shape of x.

        Raises
        ------
        ValueError
            If the ending is unknown, shapes do not fit, or nodes have no coordinates.
        """
        write_motion(self, Path(path), x, t, v)

    def draw(self, x: Array, ax: Axes | None = None, scale: float | None = None) -> Axes:
        """Plot the nodes at rest in grey and displaced, in the two widest directions.

        `scale` magnifies the displacements; default: the largest becomes a tenth of the model.
        """
        from vibroimpact.style import ADMISSIBLE, PHANTOM, legend, new_axes

        ax = ax or new_axes()
        factor = self._factor(np.asarray(x)) if scale is None else scale
        rest, moved = self.displaced(x, factor)
        across, up = self._view(rest, moved)
        ax.plot(rest[:, across], rest[:, up], ".", color=PHANTOM, markersize=2, label="at rest")
        name = f"displaced, times {factor:.3g}"
        ax.plot(moved[:, across], moved[:, up], ".", color=ADMISSIBLE, markersize=2, label=name)
        ax.set_xlabel(self._axis(across))
        ax.set_ylabel(self._axis(up))
        legend(ax)
        return ax

    def animate(self, x: Array, scale: float | None = None) -> FuncAnimation:
        """Return the animation of a motion on the geometry; ``.save("mode.gif")`` writes it.

        Parameters
        ----------
        x : array, shape (time, dof)
            Displacements half a period long, such as ``result.waveform[0]`` with ``tau`` from -1
            to 1; the animation goes there and back.
        scale : float, optional
            As of `draw`.
        """
        from matplotlib.animation import FuncAnimation

        frames = np.asarray(x)
        largest = frames[np.abs(frames).max(axis=1).argmax()]
        factor = self._factor(largest) if scale is None else scale
        ax = self.draw(largest, scale=factor)
        moved = ax.lines[1]
        across, up = self._view(*self.displaced(largest, factor))

        def show(frame: int) -> list[Any]:
            _, places = self.displaced(frames[frame], factor)
            moved.set_data(places[:, across], places[:, up])
            return [moved]

        figure = ax.get_figure(root=True)
        assert figure is not None
        there = list(range(len(frames)))
        return FuncAnimation(figure, show, frames=there + there[-2:0:-1], blit=False)

    def _factor(self, x: Array) -> float:
        rest, moved = self.displaced(x)
        largest = float(np.abs(moved - rest).max(initial=0.0))
        return 0.1 * float(np.ptp(rest, axis=0).max(initial=0.0)) / largest if largest else 1.0

    def _view(self, rest: Array, moved: Array) -> tuple[int, int]:
        """Return the two directions in which the model and its motion extend most."""
        spans = np.ptp(np.concatenate([rest, moved]), axis=0)
        across = int(np.argmax(np.ptp(rest, axis=0)))
        spans[across] = -1.0
        return across, int(np.argmax(spans))

    def _axis(self, direction: int) -> str:
        unit = "" if self.units is None else f" ({self.units['length']})"
        return f"{DIRECTIONS[direction]}{unit}"


def _symmetric(name: str, given: Any, rounding: float, symmetrize: bool) -> Any:
    """Return a matrix as rows of its nonzero entries; a triangle stands for the whole."""
    matrix = symmetry.square(name, given)
    try:
        symmetry.check(name, matrix, rounding)
    except symmetry.NotSymmetricError as error:
        if not symmetrize:
            raise ValueError(
                f"{error}. symmetrize=True takes the mean of both, whatever it is. If it is "
                f"rounding, as of single precision, allow it: rounding={2 * error.relative:.1g}"
            ) from None
        warnings.warn(f"{name} became symmetric: {error.places}", UserWarning, stacklevel=4)
    return symmetry.mean(matrix)
