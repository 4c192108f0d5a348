"""A mass that bounces on a stop: windows of periodic motion, and the branches behind them.

The oscillator of S. W. Shaw and P. J. Holmes, J. Sound Vib. 90 (1983) 129-155, with a rigid stop
where the spring is at rest.
"""

import itertools

import scipy.linalg
from drawing import BLUE, SOFT, legend, np, panels, states, vi

ZETA, K = 0.05, 0.8
SYSTEM = vi.oscillator([vi.constraint(0, {"lower": None, "upper": 0.0}, K)], zeta=ZETA)
DRIVE, LOW, HIGH, COUNT = [vi.drive(0, 1.0)], 2.5, 3.6, 276
# Periods of the drive for one impact, the range of the branch, and branches at its flips.
BRANCHES = ((1, LOW, 2.8, 1), (2, HIGH, 3.15, 1))
LEAST = 4  # frequencies in a window that is marked


def draw(client):
    figure, ax = panels(size=(7, 3.6))
    ax.text(LOW, 0.89, "period ", ha="right", va="bottom", fontsize=7)
    request = vi.attractors_request(
        SYSTEM, LOW, DRIVE, [[-0.1], [-0.5], [-1.0]], [[0.0], [0.5], [-0.5]],
        settle=300, observe=100, section="impacts", points=100, outputs=("section",),
    )  # fmt: skip
    swept = client.sweep("attractors", request, {"frequency.values.0": (LOW, HIGH, COUNT)})
    Omega = np.linspace(LOW, HIGH, COUNT)
    ax.plot(
        np.repeat(Omega, swept.section_count), swept.section.velocity, "o", color=BLUE,
        markersize=1.1, markeredgewidth=0, label="time histories",
    )  # fmt: skip
    for periods, begin, end, switch in BRANCHES:
        request = vi.periodic_motions_request(
            SYSTEM, [begin], DRIVE, periods=periods, outputs=("exists", "stability")
        )
        result = client.branches(request, "frequency.values.0", begin, end, switch=switch, step=0.1)
        curves(ax, result)
        flips = result.points.parameter[(result.points.type == "flip") & result.points.exists]
        for at in flips:
            ax.axvline(at, color=SOFT, linewidth=0.5, linestyle=(0, (1, 2)), zorder=0)
        doubles(client, periods, flips[0])
    periodic = list(windows(swept, Omega))
    # Bounces of one period of the drive, of two, and windows in between.
    assert {1, 2, 4} <= {period for _, _, period in periodic}
    assert periodic[0][::2] == (LOW, 1)
    assert periodic[-1][1:] == (HIGH, 2)
    for start, stop, period in periodic:
        ax.plot([start, stop], [0.88, 0.88], color="black", linewidth=1.0)
        ax.text(0.5 * (start + stop), 0.89, str(period), ha="center", va="bottom", fontsize=7)
    ax.plot([], [], linestyle=(0, (3, 1.5)), color=SOFT, linewidth=1.1, label="unstable branches")
    ax.plot([], [], linestyle=(0, (1, 2)), color=SOFT, linewidth=0.5, label="flips")
    ax.set_xlim(LOW, HIGH)
    ax.set_ylim(0.0, 0.95)
    ax.set_xlabel(r"frequency of the drive $\Omega/\Omega_0$")
    ax.set_ylabel(r"impact speed $v\,\Omega_0 m/F$")
    legend(ax)
    return figure


def curves(ax, result):
    """Plot the speeds of all impacts of admissible motions."""
    rows = result.solution
    for branch in np.unique(rows.branch[rows.impacts > 0]):
        mine = np.flatnonzero(rows.branch == branch)
        speeds = result.impact.velocity[np.isin(result.impact.solution, mine)]
        first = ax.get_legend_handles_labels()[1].count("branches") == 0 and rows.exists[mine].any()
        for speed in speeds.reshape(mine.size, -1).T:
            shown = np.where(rows.exists[mine], speed, np.nan)
            states(
                ax, rows.parameter[mine], shown, rows.exists[mine], rows.stability[mine], SOFT,
                "branches" if first else "",
            )  # fmt: skip
            first = False


def doubles(client, periods, Omega):
    """Assert that a small deviation comes back reversed, by the flow and the jump of one mass."""
    motions = client.periodic_motions(SYSTEM, [Omega], DRIVE, periods=periods)
    (at,) = np.flatnonzero(motions.solution.exists[motions.impact.solution])
    v, force, T = motions.impact.velocity[at], np.cos(motions.impact.phase[at]), 2 * np.pi / Omega
    before, after = force - 2 * ZETA * v, force + 2 * ZETA * K * v  # accelerations at x = 0
    jump = np.array([[-K, 0.0], [(after + K * before) / v, -K]])
    Z = jump @ scipy.linalg.expm(periods * T * np.array([[0.0, 1.0], [-1.0, -2 * ZETA]]))
    assert abs(np.linalg.det(np.eye(2) + Z)) < 1e-9


def windows(swept, Omega):
    """Yield the ranges in which all motions settle on one attractor, and its period."""
    periods = np.split(swept.attractor.period, swept.attractor_offset[1:])
    of = [int(some[0]) if some.size == 1 else 0 for some in periods]
    for period, run in itertools.groupby(range(Omega.size), key=of.__getitem__):
        points = list(run)
        if period > 0 and len(points) >= LEAST:
            yield Omega[points[0]], Omega[points[-1]], period
