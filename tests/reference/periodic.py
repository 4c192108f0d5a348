"""Periodic motions with impacts in ball arithmetic, without modes: an independent reference.

The state (x, x') with the load's sines and cosines and a constant as further unknowns moves by one
matrix exponential. A motion of period T with impacts at given times is the solution of linear
equations; Newton's method with differences makes the times and impulses those of the walls and of
Newton's law, so that they are known to dozens of digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import flint
import numpy as np
from flint import acb_mat, arb, arb_mat

DIGITS = 50


@dataclass
class Structure:
    """M x'' + C x' + K x = force + sum of amplitude cos(harmonic Omega t + phase) on one dof."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    force: np.ndarray
    loads: list[tuple[int, float, int, float]]
    Omega: float

    def __post_init__(self) -> None:
        flint.ctx.dps = DIGITS
        n = self.M.shape[0]
        self.n = n
        orders = sorted({harmonic for _, _, harmonic, _ in self.loads})
        size = 2 * n + 2 * len(orders) + 1
        M = arb_mat(self.M.tolist())
        inverse = M.solve(arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)]))
        stiff, damped = inverse * arb_mat(self.K.tolist()), inverse * arb_mat(self.C.tolist())
        self.inverse = inverse
        A = [[arb(0)] * size for _ in range(size)]
        for i in range(n):
            A[i][n + i] = arb(1)
            for j in range(n):
                A[n + i][j], A[n + i][n + j] = -stiff[i, j], -damped[i, j]
        vectors = []
        for harmonic in orders:
            cosine, sine = [arb(0)] * n, [arb(0)] * n
            for dof, amplitude, order, phase in self.loads:
                if order == harmonic:
                    cosine[dof] += arb(amplitude) * arb(phase).cos()
                    sine[dof] -= arb(amplitude) * arb(phase).sin()
            vectors += [cosine, sine]
        vectors.append([arb(float(f)) for f in self.force])
        for column, vector in enumerate(vectors):
            pushed = inverse * arb_mat([[v] for v in vector])
            for i in range(n):
                A[n + i][2 * n + column] = pushed[i, 0]
        for k, harmonic in enumerate(orders):
            rate, c = harmonic * arb(self.Omega), 2 * n + 2 * k
            A[c][c + 1], A[c + 1][c] = -rate, rate
        self.A, self.size, self.orders = arb_mat(A), size, orders
        self.vectors = vectors

    def flow(self, time: arb) -> arb_mat:
        """Return the flow of the augmented state over a time."""
        return (self.A * time).exp()

    def separation(self) -> float:
        """Return the smallest relative distance of the natural frequencies."""
        squares = np.sort(np.linalg.eigvals(np.linalg.solve(self.M, self.K)).real)
        return float((np.diff(squares) / np.abs(squares[1:])).min(initial=1.0))

    def damping_ratio(self) -> float:
        """Return the smallest ratio of damping of the modes."""
        n = self.n
        M, C, K = self.M, self.C, self.K
        A = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, each) for each in (K, C)]]
        )
        roots = np.linalg.eigvals(A)
        return float((-roots.real / np.abs(roots)).min())

    def condition(self) -> float:
        """Return the condition number of the complex modes, velocities over the largest rate."""
        n = 2 * self.n
        own = acb_mat([[self.A[i, j].mid() for j in range(n)] for i in range(n)])
        rates, vectors = own.eig(right=True, algorithm="approx")
        V = np.array([[complex(vectors[i, j].mid()) for j in range(n)] for i in range(n)])
        V[self.n :] /= max(abs(complex(rate.mid())) for rate in rates)
        return float(np.linalg.cond(V / np.linalg.norm(V, axis=0)))

    def integral(self, form: arb_mat, time: arb, state: arb_mat) -> arb:
        """Return the integral of ``state(t)^T form state(t)`` over a time.

        By the block exponential of Van Loan over a short time, and by doubling.
        """
        size, norm = self.size, 0.0
        for i in range(size):
            norm = max(norm, sum(abs(float(self.A[i, j].mid())) for j in range(size)))
        halvings = max(0, int(np.ceil(np.log2(norm * float(time.mid()) + 1.0))))
        block = arb_mat(2 * size, 2 * size)
        for i in range(size):
            for j in range(size):
                block[i, j], block[size + i, size + j] = -self.A[j, i], self.A[i, j]
                block[i, size + j] = form[i, j]
        whole = (block * (time / 2**halvings)).exp()
        places = range(size)
        upper = arb_mat([[whole[i, size + j] for j in places] for i in places])
        flow = arb_mat([[whole[size + i, size + j] for j in places] for i in places])
        total = flow.transpose() * upper
        for _ in range(halvings):
            total = (total + flow.transpose() * total * flow).mid()
            flow = (flow * flow).mid()
        return (state.transpose() * total * state)[0, 0]

    def load_state(self, theta: arb) -> list[arb]:
        """Return sines and cosines at a phase of the drive, and the constant."""
        rows = []
        for harmonic in self.orders:
            rows += [(harmonic * theta).cos(), (harmonic * theta).sin()]
        return [*rows, arb(1)]


@dataclass
class Impact:
    """A wall: direction, signed position, side and restitution."""

    w: np.ndarray
    wall: float
    side: int
    restitution: float


class Motion:
    """The motion of period `periods` drive periods with one impact, or symmetric (sign -1)."""

    def __init__(self, structure: Structure, impact: Impact, periods: float, sign: int) -> None:
        self.s, self.impact, self.sign = structure, impact, sign
        flint.ctx.dps = DIGITS
        self.cell = 2 * arb.pi() * arb(periods) / arb(structure.Omega)
        self.whole = structure.flow(self.cell)
        n, E = structure.n, self.whole
        self.w = [arb(float(v)) for v in impact.w]
        self.kick = structure.inverse * arb_mat([[v] for v in self.w])
        self.mu = sum((self.w[i] * self.kick[i, 0] for i in range(n)), arb(0))
        # z = sign (E11 z + E12 l) + kick p is linear in the load's state l and in p.
        left = arb_mat([[int(i == j) - sign * E[i, j] for j in range(2 * n)] for i in range(2 * n)])
        right = [
            [sign * E[i, j] for j in range(2 * n, structure.size)]
            + [self.kick[i - n, 0] if i >= n else arb(0)]
            for i in range(2 * n)
        ]
        self.response = left.solve(arb_mat(right))

    def _along(self, column: int, start: int) -> arb:
        rows = range(self.s.n)
        return sum((self.w[i] * self.response[start + i, column] for i in rows), arb(0))

    def at(self, theta: arb) -> tuple[arb, arb, arb_mat]:
        """Return position - wall with p by Newton's law, p along w, and the state after."""
        n, load = self.s.n, self.s.load_state(theta)
        columns = range(len(load))
        k = arb(self.impact.restitution)
        # velocity before = (after - mu p); mu p = -(1 + k) velocity before
        a = sum((load[j] * self._along(j, n) for j in columns), arb(0))
        b = self._along(len(load), n) - self.mu
        p = -(1 + k) * a / (self.mu + (1 + k) * b)
        z = self.response * arb_mat([[v] for v in [*load, p]])
        y = sum((self.w[i] * z[i, 0] for i in range(n)), arb(0))
        return y - arb(self.impact.wall), p, z

    def gain(self) -> float:
        """Return ``1 + (1 + k) b / mu`` of Newton's law for p, b being what p makes of velocity.

        It is zero where neither impacts nor damping take energy: p is then free.
        """
        b = self._along(2 * len(self.s.orders) + 1, self.s.n) - self.mu
        return abs(float((1 + (1 + arb(self.impact.restitution)) * b / self.mu).mid()))

    def without_impact(self) -> arb_mat:
        """Return the state of the steady response at the phase 0."""
        load = self.s.load_state(arb(0))
        return self.response * arb_mat([[v] for v in [*load, arb(0)]])

    def distances(self, phases: np.ndarray) -> np.ndarray:
        """Return position - wall at phases, a trigonometric polynomial, in double precision."""
        n, count = self.s.n, 2 * len(self.s.orders) + 1
        k = arb(self.impact.restitution)
        b = self._along(count, n) - self.mu
        share = -(1 + k) / (self.mu + (1 + k) * b)
        terms = [
            float((self._along(j, 0) + self._along(count, 0) * share * self._along(j, n)).mid())
            for j in range(count)
        ]
        waves = [f(h * phases) for h in self.s.orders for f in (np.cos, np.sin)]
        load = np.stack([*waves, np.ones_like(phases)])
        return np.asarray(terms @ load - self.impact.wall)

    def refined(self, theta: float) -> tuple[arb, arb, arb, arb_mat]:
        """Return phase, p, velocity before and state of the solution near a phase."""
        flint.ctx.dps = DIGITS
        x, h = arb(theta), arb("1e-20")
        for _ in range(6):
            value = self.at(x)[0]
            slope = (self.at(x + h)[0] - self.at(x - h)[0]) / (2 * h)
            x = arb((x - value / slope).mid())
        _, p, z = self.at(x)
        n = self.s.n
        after = sum((self.w[i] * z[n + i, 0] for i in range(n)), arb(0))
        return x, p, after - self.mu * p, z

    def path(self, theta: arb, z: arb_mat, points: int) -> np.ndarray:
        """Return displacements (point, dof) at equal times of the cell, both ends included."""
        n = self.s.n
        step = self.s.flow(self.cell / (points - 1))
        load = self.s.load_state(theta)
        state = arb_mat([[z[i, 0]] for i in range(2 * n)] + [[v] for v in load])
        rows = []
        for _ in range(points):
            rows.append([float(state[i, 0].mid()) for i in range(n)])
            moved = step * state
            # Radii would grow by the norm of each step; the digits are many enough without them.
            state = arb_mat([[moved[i, 0].mid()] for i in range(self.s.size)])
        return np.array(rows)

    def energies(self, theta: arb, z: arb_mat) -> tuple[arb, arb]:
        """Return the work of the harmonic load in a cell, and what damping takes in it."""
        s, n = self.s, self.s.n
        load = s.load_state(theta)
        state = arb_mat([[z[i, 0]] for i in range(2 * n)] + [[v] for v in load])
        power, damping = arb_mat(s.size, s.size), arb_mat(s.size, s.size)
        for i in range(n):
            for j in range(n):
                damping[n + i, n + j] = arb(float(s.C[i, j]))
            for column, vector in enumerate(s.vectors[:-1]):  # a constant load does no work
                power[n + i, 2 * n + column] = vector[i]
        return s.integral(power, self.cell, state), s.integral(damping, self.cell, state)

    def after_one_cell(self, theta: arb, z: arb_mat) -> arb_mat:
        """Return the state after the impact that ends the cell, from a state at a phase near it.

        The impact is where the coordinate reaches its wall; the state is moved by the flow
        without impact to where the phase is a cell later, as sections of constant phase ask.
        """
        s, n = self.s, self.s.n
        load = s.load_state(theta)
        state = arb_mat([[z[i, 0]] for i in range(2 * n)] + [[v] for v in load])
        wall = self.sign * arb(self.impact.wall)
        time = self.cell
        for _ in range(8):
            moved = s.flow(time) * state
            y = sum((self.w[i] * moved[i, 0] for i in range(n)), arb(0))
            v = sum((self.w[i] * moved[n + i, 0] for i in range(n)), arb(0))
            time = arb((time - (y - wall) / v).mid())
        moved = s.flow(time) * state
        v = sum((self.w[i] * moved[n + i, 0] for i in range(n)), arb(0))
        p = -(1 + arb(self.impact.restitution)) * v / self.mu
        for i in range(n):
            moved[n + i, 0] += self.kick[i, 0] * p
        moved = s.flow(self.cell - time) * moved
        return arb_mat([[self.sign * moved[i, 0]] for i in range(2 * n)])

    def monodromy(self, theta: arb, z: arb_mat, p: arb) -> arb_mat:
        """Return the linearised motion over a cell that ends after the impact, (2 n, 2 n).

        The jump of deviations is the saltation matrix R + (F+ - R F-) grad / (grad . F-).
        """
        s, n = self.s, self.s.n
        size, k = 2 * n, arb(self.impact.restitution)
        load = s.load_state(theta)
        after = arb_mat([[z[i, 0]] for i in range(size)] + [[v] for v in load])
        before = arb_mat(after)
        for i in range(n):
            before[n + i, 0] -= self.kick[i, 0] * p
        later, earlier = s.A * after, s.A * before
        R = arb_mat(size, size, [int(i == j) for i in range(size) for j in range(size)])
        for i in range(n):
            for j in range(n):
                R[n + i, n + j] -= (1 + k) * self.kick[i, 0] * self.w[j] / self.mu
        speed = sum((self.w[i] * earlier[i, 0] for i in range(n)), arb(0))
        reset = R * arb_mat([[earlier[i, 0]] for i in range(size)])
        S = arb_mat(R)
        for i in range(size):
            for j in range(n):
                S[i, j] += (later[i, 0] - reset[i, 0]) * self.w[j] / speed
        E = arb_mat([[self.sign * self.whole[i, j] for j in range(size)] for i in range(size)])
        return S * E

    def multipliers(self, theta: arb, z: arb_mat) -> np.ndarray:
        """Return the multipliers of the cell by central differences in extended precision."""
        n = self.s.n
        h = arb("1e-15")
        columns = []
        for j in range(2 * n):
            both = []
            for sign in (1, -1):
                moved = arb_mat([[z[i, 0] + (sign * h if i == j else 0)] for i in range(2 * n)])
                both.append(self.after_one_cell(theta, moved))
            columns.append(
                [float(((both[0][i, 0] - both[1][i, 0]) / (2 * h)).mid()) for i in range(2 * n)]
            )
        return np.linalg.eigvals(np.array(columns).T)
