"""A particle between two stops on a driven mass: the impact damper of Masri and Caughey.

S. F. Masri and T. K. Caughey, On the stability of the impact damper, J. Appl. Mech. 33 (1966)
586-592. The limiter acts on the difference of both displacements.
"""

from drawing import BLUE, SOFT, WALL, legend, line, np, panels, state_keys, states, tracks, vi

ZETA, MU, K, CLEARANCE, FORCE = 0.01, 0.1, 0.3, 1.0, 0.1
SYSTEM = vi.system(
    [1.0, MU],
    [1.0, 0.0],
    [vi.constraint(direction={1: 1.0, 0: -1.0}, gap=CLEARANCE, restitution=K)],
    C=[2 * ZETA, 0.0],
)
FREE = (0, (5, 1, 1, 1))
DRIVE = [vi.drive(0, FORCE)]


def draw(client):
    figure, axes = panels(1, 2, (7, 3.0))
    result = client.periodic_motions(
        SYSTEM, (0.8, 1.2, 401), DRIVE, sequence="symmetric", tau=np.arange(401) / 400
    )
    rows, Omega, ax = result.solution, result.Omega, axes[0]
    bare = FORCE / np.hypot(1 - Omega**2, 2 * ZETA * Omega)
    ax.plot(Omega, bare, color=WALL, linewidth=0.8, linestyle=FREE, label="no particle")
    for k, track in enumerate(tracks(result, 2)):
        there = track >= 0
        states(
            ax, Omega, np.where(there, rows.x_max[track, 0], np.nan),
            there & rows.exists[track], rows.stability[track], SOFT, "" if k else "with particle",
        )  # fmt: skip
    state_keys(ax)
    ax.set_xlim(Omega[0], Omega[-1])
    ax.set_ylim(0.0, 1.05 * bare.max())
    ax.set_xlabel(r"frequency of the drive $\Omega/\Omega_0$")
    ax.set_ylabel(r"amplitude of the mass / clearance")
    legend(ax, 2)
    settled = np.flatnonzero(rows.exists & (rows.impacts == 2) & (rows.stability <= 1))
    triangle(result, settled)
    # At resonance: less than a tenth of the mass's own response, by a tenth of its mass.
    shown = settled[np.argmin(np.abs(rows.Omega[settled] - 1.0))]
    assert rows.x_max[shown, 0] < 0.1 * bare.max()
    motion(axes[1], result, shown)
    return figure


def triangle(result, settled):
    """Assert that the particle moves uniformly: its amplitude is p T / (8 mu).

    An impact turns its velocity v round, p = 2 mu v, and in half a period it goes from one end of
    its path to the other one. It turns the work of the drive into heat, which damping does not.
    """
    rows, first = result.solution, np.searchsorted(result.impact.solution, settled)
    p, T = result.impact.momentum[first], 2 * np.pi / rows.Omega[settled]
    np.testing.assert_allclose(rows.x_max[settled, 1], p * T / (8 * MU), rtol=1e-10)
    np.testing.assert_allclose(rows.energy_lost[settled], rows.work[settled], rtol=1e-10)


def motion(ax, result, row):
    """Plot both displacements over two periods, and the room of the particle."""
    x, tau = result.waveform[row], np.arange(401) / 400
    for begin in (0, 1):
        labels = ("mass", "particle") if begin == 0 else ("", "")
        room = ax.fill_between(
            begin + tau, x[:, 0] - CLEARANCE, x[:, 0] + CLEARANCE, color="#e3edf4", linewidth=0
        )
        line(ax, begin + tau, x[:, 0], BLUE, labels[0])
        line(ax, begin + tau, x[:, 1], SOFT, labels[1])
    room.set_label("between its stops")
    ax.set_xlim(0, 2)
    ax.set_xlabel("periods of the drive")
    ax.set_ylabel("displacement / clearance")
    legend(ax, 3)
