"""Motions between walls by matrix exponentials of the equations of motion as they are.

Independent of the solvers: no modes, no series in time, no bounds. First-order equations with loads
and a constant as further states, ``z' = A z``, in the displacements that were given, by FLINT's
matrix exponential with many digits; small steps on which a coordinate is compared with its walls at
the ends and at its highest place; roots by bisection and secants. Constraints at rest take the
acceleration out of their coordinate; chatter is followed until its velocity is below `REST`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import flint

from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history import Harmonic

DIGITS = 90
REST = 1e-28
"""Velocity at a wall that presses from which on a constraint rests there."""
Contact = tuple[int, int]


def _arb(values: Any) -> Any:
    return flint.arb_mat([[flint.arb(float(v)) for v in row] for row in values])


@dataclass
class ContactMotion:
    """Motions of a system; to be used at a precision of `DIGITS`.

    Parameters
    ----------
    system : System
    load : sequence of Harmonic
    """

    system: System
    load: Sequence[Harmonic] = ()
    exponentials: dict[Any, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n, system = self.system.n, self.system
        self.n, self.size = n, 2 * n + 2 * len(self.load) + 1
        self.inverse = _arb(system.M.to_dense()).inv()
        self.K = _arb(system.K.to_dense())
        self.C = flint.arb_mat(n, n) if system.C is None else _arb(system.C.to_dense())
        self.W = _arb(system.directions(range(len(system.constraints))))
        self.mobility = self.W * self.inverse * self.W.transpose()
        # The forces of the system by the whole state, those of its walls left out.
        self.forces = flint.arb_mat(n, self.size)
        for i in range(n):
            for j in range(n):
                self.forces[i, j], self.forces[i, n + j] = -self.K[i, j], -self.C[i, j]
            if system.force is not None:
                self.forces[i, self.size - 1] = flint.arb(float(system.force[i]))
        for k, term in enumerate(self.load):
            place, a = 2 * n + 2 * k, flint.arb(term.amplitude)
            sine, cosine = flint.arb(term.phase).sin_cos()
            self.forces[term.dof, place] += a * cosine
            self.forces[term.dof, place + 1] += -a * sine

    def rows(self, contacts: Sequence[Contact]) -> Any:
        table = self.W.tolist()
        return flint.arb_mat([[side * w for w in table[i]] for i, side in contacts])

    def reaction(self, contacts: Sequence[Contact]) -> Any:
        """Return the forces with which constraints at rest press, by the state."""
        rows = self.rows(contacts)
        return (rows * self.inverse * rows.transpose()).inv() * rows * self.inverse * self.forces

    def equations(self, contacts: Sequence[Contact]) -> Any:
        n, A = self.n, flint.arb_mat(self.size, self.size)
        rates = self.inverse * self.forces
        if contacts:
            rates -= self.inverse * self.rows(contacts).transpose() * self.reaction(contacts)
        for i in range(n):
            A[i, n + i] = flint.arb(1)
            for j in range(self.size):
                A[n + i, j] = rates[i, j]
        for k, term in enumerate(self.load):
            place = 2 * n + 2 * k
            A[place, place + 1] = -flint.arb(term.frequency)
            A[place + 1, place] = flint.arb(term.frequency)
        return A

    def start(self, x: Sequence[float], v: Sequence[float]) -> Any:
        z = [flint.arb(float(value)) for value in (*x, *v)]
        for _ in self.load:
            z += [flint.arb(1), flint.arb(0)]
        return flint.arb_mat([[value] for value in (*z, flint.arb(1))])

    def at(self, contacts: tuple[Contact, ...], z: Any, s: Any) -> Any:
        A = self.exponentials.setdefault((contacts, "A"), self.equations(contacts))
        return ((A * s).exp() * z).mid()

    def watched(self, contacts: tuple[Contact, ...]) -> list[tuple[Contact, bool, Any, Any]]:
        """Return rows and walls of what must not grow beyond them: coordinates, and tensions."""
        watched, held = [], {index for index, _ in contacts}
        for index, constraint in enumerate(self.system.constraints):
            for side, wall in ((1, constraint.upper), (-1, constraint.lower)):
                if wall is not None and index not in held:
                    row = flint.arb_mat(1, self.size)
                    for j, w in enumerate(self.rows([(index, side)]).entries()):
                        row[0, j] = w
                    watched.append(((index, side), False, row, flint.arb(wall)))
        if contacts:
            for contact, row in zip(contacts, self.reaction(contacts).tolist(), strict=True):
                tension = flint.arb_mat([[-value for value in row]])
                watched.append((contact, True, tension, flint.arb(0)))
        return watched

    def follow(
        self, x: Sequence[float], v: Sequence[float], t_end: float, dt: float
    ) -> tuple[list[Any], list[Any], list[tuple[Any, Contact, Any]]]:
        """Return displacements and velocities at the end, and impacts (time, contact, velocity)."""
        z, now, impacts = self.start(x, v), flint.arb(0), list[tuple[Any, Contact, Any]]()
        contacts: tuple[Contact, ...] = ()
        end, leaving = flint.arb(t_end), set[Contact]()
        while now < end:
            step = flint.arb(dt)
            step = step if step < end - now else (end - now).mid()
            event = self._event(contacts, z, step, leaving)
            if event is None:
                z, now, leaving = self.at(contacts, z, step), (now + step).mid(), set()
                continue
            s, contact, tension = event
            z, now = self.at(contacts, z, s), (now + s).mid()
            if tension:
                contacts = tuple(c for c in contacts if c != contact)
                leaving = {contact}
                continue
            z, contacts, speed = self._strike(z, contacts, contact)
            impacts.append((now, contact, speed))
            leaving = {contact}
        return z.entries()[: self.n], z.entries()[self.n : 2 * self.n], impacts

    def _event(
        self, contacts: tuple[Contact, ...], z: Any, step: Any, leaving: set[Contact]
    ) -> tuple[Any, Contact, bool] | None:
        A = self.exponentials.setdefault((contacts, "A"), self.equations(contacts))
        key = (contacts, str(step))
        later = self.exponentials.setdefault(key, (A * step).exp()) * z
        best: tuple[Any, Contact, bool] | None = None
        for contact, tension, row, wall in self.watched(contacts):

            def room(s: Any, row: Any = row, wall: Any = wall) -> Any:
                return (wall - (row * self.at(contacts, z, s))[0, 0]).mid()

            def slope(s: Any, row: Any = row) -> Any:
                return ((row * A * self.at(contacts, z, s))[0, 0]).mid()

            begin = flint.arb(0)
            end_slope = (row * A * later)[0, 0].mid()
            if contact in leaving and not tension:
                # It goes away, and may come back within the step.
                if end_slope < 0:
                    continue
                begin = _root(slope, begin, step)  # the turning point, or the end of rest
            high = step
            if end_slope < 0 and slope(begin) > 0:
                high = _root(slope, begin, step)
            if room(high) < 0 and room(begin) > 0:
                s = _root(room, begin, high)
                if best is None or s < best[0]:
                    best = s, contact, tension
        return best

    def _strike(
        self, z: Any, contacts: tuple[Contact, ...], contact: Contact
    ) -> tuple[Any, tuple[Contact, ...], Any]:
        v = flint.arb_mat([[value] for value in z.entries()[self.n : 2 * self.n]])
        k = flint.arb(self.system.constraints[contact[0]].restitution)
        speed = (self.rows([contact]) * v)[0, 0].mid()
        held = list(contacts)
        while True:
            # Those that are pressed stay at rest; one that would be pulled leaves.
            rows = self.rows([contact, *held])
            target = flint.arb_mat([[(1 + k) * speed]] + [[flint.arb(0)]] * len(held))
            impulses = (rows * self.inverse * rows.transpose()).solve(target)
            pulled = [c for c, p in zip(held, impulses.entries()[1:], strict=True) if p.mid() < 0]
            if not pulled:
                break
            held.remove(pulled[0])
        here = tuple(sorted(held))
        after = self._with_velocities(z, v - self.inverse * rows.transpose() * impulses)
        press = (self.rows([contact]) * self.equations_rates(here) * after)[0, 0].mid()
        if k * speed < REST and press > 0:
            here = tuple(sorted((*here, contact)))
            after = self._with_velocities(
                z, v - self.inverse * rows.transpose() * impulses / (1 + k)
            )
        return after, here, speed

    def _with_velocities(self, z: Any, v: Any) -> Any:
        entries = z.entries()
        entries[self.n : 2 * self.n] = v.entries()
        return flint.arb_mat([[value] for value in entries]).mid()

    def equations_rates(self, contacts: tuple[Contact, ...]) -> Any:
        A = self.exponentials.setdefault((contacts, "A"), self.equations(contacts)).tolist()
        return flint.arb_mat(A[self.n : 2 * self.n])


def _root(function: Callable[[Any], Any], low: Any, high: Any) -> Any:
    """Return a root: the function changes its sign between two places."""
    low_value, high_value = function(low), function(high)
    for k in range(400):
        if abs(high - low) < flint.arb(10) ** (8 - DIGITS) or high_value == 0:
            break
        middle = ((low + high) / 2).mid()
        if k > 6 and k % 3:
            cut = (high - high_value * (high - low) / (high_value - low_value)).mid()
            # A little beyond the secant's root, so that both ends come closer.
            cut = (cut + (cut - (low if k % 3 == 1 else high)) * flint.arb(2) ** -24).mid()
            middle = cut if low < cut < high else middle
        value = function(middle)
        if (value < 0) == (high_value < 0):
            high, high_value = middle, value
        else:
            low, low_value = middle, value
    return high
