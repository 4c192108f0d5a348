"""Fig. 10.19: inelastic walls, eps = 0.05: exact, the corrected slow flow and the printed one."""

from drawing import BLUE, PHANTOM, SOFT, np, panels, vi

SYSTEM = vi.oscillator([vi.constraint(0, 1.0, 0.95)])
# Eq. 10.116 as printed, at t = 0: the chapter's initial conditions.
START = {"x": -0.012415046944248105611, "v": 5.0334895476723442024}


def draw(client):
    figure, axes = panels(3, 1, (9, 8))
    exact = client.slow_flow(SYSTEM, "restitution", "exact", START, (0, 100, 10001))
    assert (exact.impacts.time < 15).sum() == 21
    assert exact.impacts.time.size == 63
    axes[0].plot(exact.t, exact.x[:, 0], color=PHANTOM, linewidth=3, label="exact")
    looks = {"printed": SOFT, "corrected": BLUE}
    for variant, color in looks.items():
        flow = client.slow_flow(SYSTEM, "restitution", variant, START, (0, 100, 10001))
        axes[0].plot(flow.t, flow.x[:, 0], color=color, linewidth=1.0, label=variant)
        axes[1].semilogy(flow.impacts.time, np.abs(flow.error.gamma), color=color, label=variant)
        axes[2].semilogy(flow.impacts.time, np.abs(flow.error.phi), color=color, label=variant)
        worst = np.abs(flow.error.gamma).max(), np.abs(flow.error.phi).max()
        if variant == "corrected":
            assert worst[0] <= 1e-4
            assert worst[1] <= 0.02
        else:
            np.testing.assert_allclose(worst, [7.5e-2, 3.2], rtol=0.02)
    axes[1].set_ylim(1e-7, 1)
    axes[2].set_ylim(1e-5, 10)
    axes[0].set_xlim(0, 30)
    axes[0].set_ylim(-1.6, 1.1)
    axes[0].set_ylabel("x")
    axes[1].set_ylabel(r"error of $\lambda$")
    axes[2].set_ylabel(r"error of $\varphi$ at impacts")
    axes[2].set_xlabel("t")
    axes[0].legend(frameon=False, ncols=3, loc="lower left")
    axes[1].legend(frameon=False)
    return figure
