"""A cantilever of finite elements with a mass and a stop at its tip, driven in the middle.

Steel, 500 x 30 x 3 mm; the arrangement is that of the experiments of F. C. Moon and S. W. Shaw,
Int. J. Non-Linear Mech. 18 (1983) 465-477. Its data are chosen here.
"""

import scipy.linalg
from drawing import BLUE, PHANTOM, SOFT, WALL, branches, np, panels, say, vi

LENGTH, WIDTH, HEIGHT, YOUNG, DENSITY = 0.5, 0.03, 3e-3, 210e9, 7850.0
BENDING, LINE = YOUNG * WIDTH * HEIGHT**3 / 12, DENSITY * WIDTH * HEIGHT
ELEMENTS, GAP, RATIO = 8, 1e-3, 0.03
TIP_MASS = 0.5 * LINE * LENGTH
TIP, MIDDLE = 2 * ELEMENTS - 2, ELEMENTS - 2
FREE = (0, (5, 1, 1, 1))
UNITS = {"length": "m", "mass": "kg", "time": "s"}


def matrices():
    """Return M and K of Euler and Bernoulli's beam, without the mass at the tip."""
    a = LENGTH / ELEMENTS
    bend = np.array(
        [
            [12, 6 * a, -12, 6 * a],
            [6 * a, 4 * a**2, -6 * a, 2 * a**2],
            [-12, -6 * a, 12, -6 * a],
            [6 * a, 2 * a**2, -6 * a, 4 * a**2],
        ]
    )
    move = np.array(
        [
            [156, 22 * a, 54, -13 * a],
            [22 * a, 4 * a**2, 13 * a, -3 * a**2],
            [54, 13 * a, 156, -22 * a],
            [-13 * a, -3 * a**2, -22 * a, 4 * a**2],
        ]
    )
    M, K = np.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
    for element in range(ELEMENTS):
        here = slice(2 * element, 2 * element + 4)
        M[here, here] += LINE * a / 420 * move
        K[here, here] += BENDING / a**3 * bend
    return M[2:, 2:], K[2:, 2:]  # clamped


def structure():
    """Return M, C, K with the mass at the tip, and both natural frequencies that are driven."""
    M, K = matrices()
    # cos z cosh z = -1: the first natural frequency of the bare beam.
    exact = 1.8751040687**2 * np.sqrt(BENDING / LINE) / LENGTH**2
    bare = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[0])
    assert abs(bare / exact - 1) < 1e-5
    M[TIP, TIP] += TIP_MASS
    natural = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[:2])
    # Rayleigh's damping, of one ratio in both modes.
    C = 2 * RATIO / natural.sum() * (natural.prod() * M + K)
    return M, C, K, natural


def linear(M, C, K, Omega):
    """Return the amplitudes of the tip by a unit force, without a stop: dynamic stiffness."""
    force = np.zeros(len(M))
    force[MIDDLE] = 1.0
    each = [np.linalg.solve(K - w**2 * M + 1j * w * C, force)[TIP] for w in Omega]
    return np.abs(each)


def draw(client):
    figure, axes = panels(1, 2, (7, 3.3))
    M, C, K, natural = structure()
    limit = vi.constraint(TIP, {"lower": None, "upper": GAP}, 0.8)
    system = vi.system(M, K, [limit], C=C, units=UNITS)
    ranges, names = ((0.75, 1.4), (0.78, 1.15)), ("first", "second")
    for ax, Omega, (low, high), name in zip(axes, natural, ranges, names, strict=True):
        # Without a stop, the resonance would reach four times as far.
        force = 4 * GAP / linear(M, C, K, [Omega])[0]
        low, high = Omega * low / (2 * np.pi), Omega * high / (2 * np.pi)
        request = vi.periodic_motions_request(
            system, [low], [vi.drive(MIDDLE, force)], unit="Hz", dofs=[TIP],
            outputs=("exists", "stability", "waveform"), tau=np.arange(256) / 256,
        )  # fmt: skip
        result = client.branches(request, "frequency.values.0", low, high)
        rows, points = result.solution, result.points
        hertz = np.linspace(low, high, 400)
        free = force * linear(M, C, K, 2 * np.pi * hertz)
        ax.plot(hertz, 1e3 * free, color=WALL, linewidth=0.8, linestyle=FREE, label="no stop")
        height = 0.5e3 * np.ptp(result.waveform[..., 0], axis=1)
        branches(ax, result, height, (BLUE, SOFT))
        # The first touches are where the linear response is as large as the gap.
        graze = points.parameter[(points.type == "grazing") & points.exists]
        assert graze.size >= 4
        np.testing.assert_allclose(force * linear(M, C, K, 2 * np.pi * graze), GAP, rtol=1e-9)
        stable = rows.exists & (rows.impacts == 1) & (rows.stability <= 1)
        assert stable.any() == (name == "first")
        ax.axhline(1e3 * GAP, color=PHANTOM, linewidth=0.5)
        ax.set_xlabel("frequency of the drive (Hz)")
        ax.set_xlim(low, high)
        ax.set_ylim(0.0, 4.6)
        say(ax, f"{name} mode, {force:.3g} N")
    axes[0].set_ylabel("amplitude of the tip (mm)")
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside upper left",
        ncols=5,
        frameon=False,
        fontsize=7.5,
    )
    return figure
