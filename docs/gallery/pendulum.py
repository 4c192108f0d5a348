"""Profiles of the double pendulum, Fig. 10.9 and 10.10: n = 20, beta = 0.702145."""

from drawing import BLUE, SOFT, WALL, close, legend, line, mode, np, panels, vi

SYSTEM = vi.double_pendulum([vi.constraint(0, 0.1)], mu=2.0)


def draw(client, omega, p, shape, difference):
    """Draw horizontal displacements of both masses, x1 = phi1 and x2 = phi1 + phi2."""
    figure, ax = panels(size=(5, 2.8))
    # beta_1 = beta / (m2 g l Delta_1), the force of eq. 10.33 in units of m2 g l.
    result, soft, turn = mode(
        client, SYSTEM, omega, p, 0, 4 / omega, 1 / omega, exponent=39, stiffness=0.702145 / 0.1
    )
    close(result.shape[0], shape)
    for angles, color, name, marker in (
        (result.shape[0], BLUE, "impact mode", "o"),
        (soft.x[turn], SOFT, "soft limiter", "x"),
    ):
        across = [0.0, angles[0], angles.sum()]
        line(ax, across, [0, -1, -2], color, name, marker=marker, markersize=5)
    ax.vlines([-0.1, 0.1], -1.15, -0.85, color=WALL, linewidth=3)
    deviation = np.abs(soft.x[turn] - shape).max()
    assert deviation < difference, deviation
    ax.set_xlabel("horizontal displacement")
    ax.set_yticks([0, -1, -2], ["support", "top mass", "bottom mass"])
    legend(ax, title=rf"$\omega$ = {omega:.4f}", title_fontsize=7.5)
    return figure
