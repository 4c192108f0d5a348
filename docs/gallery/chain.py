"""Mode shapes of chains compared with time histories and soft limiters, Fig. 10.13-10.18."""

import drawing
from drawing import SOFT, np, profile, vi


def natural(n):
    """Return the natural frequencies 2 sin(pi j / 2 (n + 1)), eq. 10.63."""
    return 2 * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1)))


def mode(client, n, dofs, omega, p, quarter=1, alpha=0.955):
    """Return an impact mode, the motion with soft limiters from its start, and its shape.

    The shape of that motion is taken at the end of the given quarter of the period.
    """
    system = vi.chain(n, [vi.constraint(dof, 0.2) for dof in dofs])
    around = quarter / omega
    result, soft, turn = drawing.mode(
        client, system, omega, p, dofs[0], around + 1 / omega, around, scale=alpha
    )
    return result, soft, soft.x[turn]


def both(ax, result, soft, dofs, difference):
    """Plot both shapes; their relative difference is less than the given one."""
    shape = result.shape[0]
    profile(ax, shape, {dof + 1: 0.2 for dof in dofs}, "impact mode")
    profile(ax, soft, None, "soft limiter", SOFT, "x")
    part = np.abs(soft - shape).max() / np.abs(shape).max()
    assert part < difference, part
    drawing.legend(ax, title=rf"$\omega$ = {result.omega[0]:.5f}", title_fontsize=7.5)
