"""Fig. 10.3: the damped impact oscillator, exact, averaged and truncated, with its free decay."""

from drawing import BLUE, OTHER, SOFT, WALL, close, legend, line, np, panels, vi

SYSTEM = vi.oscillator([vi.constraint(0, 1.0)], Omega0=1.0, zeta=0.01)
DURATIONS = {
    "exact": 91.691788284919460380,
    "averaged": 92.551910757600216547,
    "truncated": 97.646103178219673494,
    "leading": 103.05103088617776197,
}


def draw(client):
    figure, axes = panels(3, 1, (7, 5.6))
    looks = {"exact": BLUE, "transformed": "black", "averaged": OTHER, "truncated": SOFT}
    for variant, color in looks.items():
        flow = client.slow_flow(SYSTEM, "damped", variant, {"gamma": 0.2}, (0, 110, 5501))
        for ax in axes:
            line(ax, flow.t, flow.x[:, 0], color, variant)
        worst = np.abs(flow.error.x).max()
        if variant == "transformed":
            assert worst < 1e-6  # eq. 10.15 is an exact change of variables
        if variant == "averaged":
            assert worst < 0.05  # "practically no error": 4.8e-2 at the last impacts
    for variant, end in DURATIONS.items():
        flow = client.slow_flow(SYSTEM, "damped", variant, {"gamma": 0.2}, [0.0])
        close(flow.t_max, end)
    axes[0].set_xlim(0, 20)
    axes[1].set_xlim(20, 80)
    axes[2].set_xlim(80, 110)
    axes[2].axvline(DURATIONS["exact"], color=WALL, linewidth=0.8)
    axes[2].set_xlabel("t; the line marks the last impact, free decay follows")
    legend(axes[0])
    for ax in axes:
        ax.set_ylabel("x")
    return figure
