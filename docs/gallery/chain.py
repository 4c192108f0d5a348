"""Mode shapes of chains compared with time histories and soft limiters, Fig. 10.13-10.18."""

from drawing import SOFT, close, np, profile, soft_motion, vi


def natural(n):
    """Return the natural frequencies 2 sin(pi j / 2 (n + 1)), eq. 10.63."""
    return 2 * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1)))


def mode(client, n, dofs, omega, p, quarter=1, alpha=0.955):
    """Return an impact mode, after checks, and the motion with soft limiters from its start.

    `p` are the expected impulses. The shape of the motion with soft limiters is taken at the
    end of the given quarter of the period.
    """
    system = vi.chain(n, [vi.constraint(dof, 0.2) for dof in dofs])
    result = client.impact_modes(
        system, [omega], unit="omega", outputs=("impulse", "exists", "shape")
    )
    close(result.impulse[0], p)
    assert result.exists[0]
    period = 4 / omega
    # The exact free motion over the first quarter, too short for errors to grow.
    exact = client.time_history(
        system, float(result.Omega[0]), period / 4, t=[0.0, period / 4 * (1 - 1e-12)],
        outputs=("x", "v"),
    )  # fmt: skip
    assert np.abs(exact.x[1] - result.shape[0]).max() < 1e-9 * np.abs(result.shape).max()
    start, around = (exact.x[0], exact.v[0]), quarter * period / 4
    soft, turn = soft_motion(
        client, system, start, around + period / 4, around, dofs[0], drift=1e-6, scale=alpha
    )
    return result, soft, soft.x[turn]


def both(ax, result, soft, dofs, difference):
    """Plot both shapes; their relative difference is less than the given one."""
    shape = result.shape[0]
    profile(ax, shape, {dof + 1: 0.2 for dof in dofs}, "impact mode")
    profile(ax, soft, None, "soft limiter", SOFT, "x")
    part = np.abs(soft - shape).max() / np.abs(shape).max()
    assert part < difference, part
    ax.set_title(rf"$\omega$ = {result.omega[0]:.5f}", fontsize="medium")
    ax.legend(frameon=False, fontsize="small")
