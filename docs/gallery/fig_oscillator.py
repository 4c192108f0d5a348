"""One driven mass at one stop and between two, against the classical solutions.

S. W. Shaw and P. J. Holmes, J. Sound Vib. 90 (1983) 129-155, in the limit of a rigid stop;
S. F. Masri and T. K. Caughey, J. Appl. Mech. 33 (1966) 586-592, for symmetric motions.
"""

from drawing import BLUE, SOFT, legend, np, panels, state_keys, states, tracks, vi

ZETA, K, GAP = 0.05, 0.8, 1.0
DRIVE = [vi.drive(0, 1.0)]
ONE = {"lower": None, "upper": GAP}
CORNER = {"ha": "right", "va": "bottom", "fontsize": 7.5}


def speeds(Omega, sign):
    """Return both speeds before the impact, nan where there are none.

    The free motion begins at the stop with the velocity -k v and ends a period later at the stop
    (sign 1), or half a period later at the other one (sign -1), with v. These four equations give
    its four constants, those of the free vibration and of the response to the load, as linear
    functions of v. The amplitude of the response is known: a quadratic equation for v.
    """
    length = (1.5 + 0.5 * sign) * np.pi / Omega
    nu, decay = np.sqrt(1 - ZETA**2), np.exp(-ZETA * length)
    c, s = decay * np.cos(nu * length), decay * np.sin(nu * length)
    turn = sign  # cos(Omega length)
    A = [
        [1.0, 0.0, 1.0, 0.0],
        [-ZETA, nu, 0.0, Omega],
        [c, s, turn, 0.0],
        [-ZETA * c - nu * s, nu * c - ZETA * s, 0.0, turn * Omega],
    ]
    constant = np.linalg.solve(A, [GAP, 0.0, sign * GAP, 0.0])[2:]
    by_v = np.linalg.solve(A, [0.0, -K, 0.0, sign])[2:]
    size = 1 / np.hypot(1 - Omega**2, 2 * ZETA * Omega)
    square = [by_v @ by_v, 2 * constant @ by_v, constant @ constant - size**2]
    roots = np.roots(square)
    return np.sort(roots) if np.isreal(roots).all() else np.full(2, np.nan)


def difference(result, height, expected):
    """Return the largest difference from the classical speeds, which exist where ours do."""
    both = np.full(expected.shape, np.nan)
    for k, track in enumerate(tracks(result, result.solution.impacts.max())):
        both[:, k] = np.where(track < 0, np.nan, height[track])
    both = np.sort(both, axis=1)
    np.testing.assert_array_equal(np.isnan(both), np.isnan(expected))
    # Where both meet, rounding moves them by its square root.
    clear = expected[:, 1] - expected[:, 0] > 1e-2
    worst = np.abs(both - expected)[clear].max()
    assert worst < 1e-11, worst
    return worst


def contraction(result, cells):
    """Assert what a period does to areas: each impact shrinks them by k^2, damping does the rest.

    The product of both multipliers is therefore known, whatever the motion.
    """
    struck = result.solution.impacts > 0
    multipliers = (result.multipliers.real + 1j * result.multipliers.imaginary)[struck]
    Omega = result.solution.Omega[struck]
    expected = K ** (2 * cells) * np.exp(-4 * np.pi * ZETA / Omega)
    np.testing.assert_allclose(multipliers.prod(axis=1), expected, rtol=1e-9)


def draw(client):
    figure, axes = panels(2, 1, (7, 5.4))
    cases = ((ONE, None, 1, BLUE, 1), (GAP, "symmetric", -1, SOFT, 2))
    titles = ("one stop, one impact per period", "two stops, symmetric motions")
    for ax, (gap, sequence, sign, color, impacts), title in zip(axes, cases, titles, strict=True):
        system = vi.oscillator([vi.constraint(0, gap, K)], zeta=ZETA)
        result = client.periodic_motions(
            system,
            (0.4, 4.0, 721),
            DRIVE,
            sequence=sequence,
            outputs=("exists", "stability", "multipliers"),
        )
        rows, first = result.solution, np.unique(result.impact.solution, return_index=True)[1]
        height = np.full(rows.Omega.size, np.nan)
        height[rows.impacts > 0] = result.impact.velocity[first]
        expected = np.array([speeds(at, sign) for at in result.Omega])
        for k, track in enumerate(tracks(result, impacts)):
            there = track >= 0
            speed, exists = np.where(there, height[track], np.nan), there & rows.exists[track]
            name = "" if k else "closed form"
            states(ax, result.Omega, speed, exists, rows.stability[track], color, name)
        worst = difference(result, height, expected)
        contraction(result, impacts)
        for column, label in enumerate(("classical formula", "")):
            ax.plot(
                result.Omega[::12], expected[::12, column], "o", color="black", markersize=3.4,
                markerfacecolor="none", markeredgewidth=0.6, label=label,
            )  # fmt: skip
        state_keys(ax)
        ax.axhline(0.0, color="black", linewidth=0.5)
        ax.set_xlim(0.4, 4.0)
        ax.set_ylabel(r"impact speed $v/(\Omega_0\Delta)$")
        said = f"{title}\nlargest difference {worst:.0e}"
        ax.text(0.99, 0.05, said, **CORNER, transform=ax.transAxes)
        legend(ax)
    axes[1].set_xlabel(r"frequency of the drive $\Omega/\Omega_0$")
    return figure
