"""Fig. 10.6: impact modes of two masses and the pulses of soft limiters, alpha = 0.968, n = 9."""

from drawing import BLUE, SOFT, close, legend, line, mode, np, panels, profile, say, vi

SYSTEM = vi.two_mass([vi.constraint(0, 0.2)])
CASES = (  # omega, p, the profile at tau = 1, largest difference of the soft profile
    (2 / np.pi + 0.1, 0.07301944655444, [0.2, 0.25778865480741], 0.02),
    (2 / np.pi * np.sqrt(3) + 2.5, 2.45886419349202, [0.2, -5.53245327214269e-3], 0.03),
)


def draw(client):
    figure, axes = panels(2, 2, (7, 5))
    for row, (omega, p, shape, difference) in enumerate(CASES):
        period = 4 / omega
        result, soft, turn = mode(client, SYSTEM, omega, p, 0, 2 * period, period / 4, scale=0.968)
        close(result.shape[0], shape)
        deviation = np.abs(soft.x[turn] - shape).max()
        assert deviation < difference, deviation
        profile(axes[row, 0], result.shape[0], {1: 0.2}, "impact mode")
        profile(axes[row, 0], soft.x[turn], None, "soft limiter", SOFT, "x")
        say(axes[row, 1], rf"$\omega$ = {omega:.4f}")
        line(axes[row, 1], soft.t, (soft.x[:, 0] / (0.968 * 0.2)) ** 17, SOFT, linestyle="-")
        for impact in np.arange(period / 4, 2 * period, period / 2):
            axes[row, 1].axvline(impact, color=BLUE, linewidth=0.8)
        axes[row, 1].set_ylabel("force of the soft limiter")
        axes[row, 1].set_xlabel("t; lines: impacts of the mode")
    legend(axes[0, 0])
    return figure
