"""Fig. 10.6: impact modes of two masses and the pulses of soft limiters, alpha = 0.968, n = 9."""

from drawing import BLUE, SOFT, close, np, panels, profile, soft_motion, vi

SYSTEM = vi.two_mass([vi.constraint(0, 0.2)])
CASES = (  # omega, p, the profile at tau = 1, largest difference of the soft profile
    (2 / np.pi + 0.1, 0.07301944655444, [0.2, 0.25778865480741], 0.02),
    (2 / np.pi * np.sqrt(3) + 2.5, 2.45886419349202, [0.2, -5.53245327214269e-3], 0.03),
)


def draw(client):
    figure, axes = panels(2, 2, (9, 6))
    for row, (omega, p, shape, difference) in enumerate(CASES):
        mode = client.impact_modes(
            SYSTEM, [omega], unit="omega", outputs=("impulse", "exists", "shape")
        )
        close(mode.impulse[0, 0], p)
        close(mode.shape[0], shape)
        assert mode.exists[0]
        period = 4 / omega
        exact = client.time_history(
            SYSTEM, float(mode.Omega[0]), period, t=[0.0, period / 4 * (1 - 1e-12)],
            outputs=("x", "v"),
        )  # fmt: skip
        np.testing.assert_allclose(exact.x[1], shape, atol=1e-10)
        start = exact.x[0], exact.v[0]
        soft, turn = soft_motion(
            client, SYSTEM, start, 2 * period, period / 4, 0, drift=1e-6, scale=0.968
        )
        deviation = np.abs(soft.x[turn] - shape).max()
        assert deviation < difference, deviation
        profile(axes[row, 0], mode.shape[0], {1: 0.2}, "impact mode")
        profile(axes[row, 0], soft.x[turn], None, "soft limiter", SOFT, "x")
        axes[row, 0].set_title(rf"({'ac'[row]}) $\omega$ = {omega:.4f}", fontsize="medium")
        axes[row, 1].plot(soft.t, (soft.x[:, 0] / (0.968 * 0.2)) ** 17, color=SOFT)
        for impact in np.arange(period / 4, 2 * period, period / 2):
            axes[row, 1].axvline(impact, color=BLUE, linewidth=0.8)
        axes[row, 1].set_title(f"({'bd'[row]}) force of the soft limiter", fontsize="medium")
        axes[row, 1].set_xlabel("t; lines: impacts of the mode")
    axes[0, 0].legend(frameon=False)
    return figure
