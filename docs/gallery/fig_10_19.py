"""Fig. 10.19: inelastic walls, eps = 0.05: exact, the corrected slow flow and the printed one."""

from drawing import BLUE, PHANTOM, SOFT, legend, line, np, panels, vi

SYSTEM = vi.oscillator([vi.constraint(0, 1.0, 0.95)])
# Eq. 10.116 as printed, at t = 0: the chapter's initial conditions.
START = {"x": -0.012415046944248105611, "v": 5.0334895476723442024}


def draw(client):
    figure, axes = panels(3, 1, (7, 6))
    exact = client.slow_flow(SYSTEM, "restitution", "exact", START, (0, 100, 10001))
    assert (exact.impacts.time < 15).sum() == 21
    assert exact.impacts.time.size == 63
    axes[0].plot(exact.t, exact.x[:, 0], color=PHANTOM, linewidth=3, label="exact")
    looks = {"printed": SOFT, "corrected": BLUE}
    for variant, color in looks.items():
        flow = client.slow_flow(SYSTEM, "restitution", variant, START, (0, 100, 10001))
        line(axes[0], flow.t, flow.x[:, 0], color, variant)
        line(axes[1], flow.impacts.time, np.abs(flow.error.difference.gamma), color)
        line(axes[2], flow.impacts.time, np.abs(flow.error.difference.phi), color)
        differences = flow.error.difference
        worst = np.abs(differences.gamma).max(), np.abs(differences.phi).max()
        if variant == "corrected":
            assert worst[0] <= 1e-4
            assert worst[1] <= 0.02
        else:
            np.testing.assert_allclose(worst, [7.5e-2, 3.2], rtol=0.02)
    for ax in axes[1:]:
        ax.set_yscale("log")
    axes[1].set_ylim(1e-7, 1)
    axes[2].set_ylim(1e-5, 10)
    axes[0].set_xlim(0, 30)
    axes[0].set_ylabel("x")
    axes[1].set_ylabel(r"error of $\lambda$")
    axes[2].set_ylabel(r"error of $\varphi$ at impacts")
    axes[2].set_xlabel("t")
    legend(axes[0])
    return figure
