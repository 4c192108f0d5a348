"""Fig. 10.22: the bouncing ball, exact and by both nonsmooth transformations."""

from drawing import BLUE, OTHER, PHANTOM, SOFT, close, legend, line, np, panels, vi

# The chapter prints no parameters: g = 9.81, H = 1, eps = 0.1 are assumed.
FLOOR = vi.constraint(0, {"lower": 0.0, "upper": None}, 0.9)
SYSTEM = vi.bouncing_ball([FLOOR], g=9.81)
LOOKS = {"exact": PHANTOM, "nstt": SOFT, "nsct": OTHER, "corrected": BLUE}


def draw(client):
    figure, axes = panels(2, 1, (7, 4.6))
    for variant, color in LOOKS.items():
        ball = client.slow_flow(SYSTEM, "bouncing_ball", variant, {"x": 1.0}, (0, 9.2, 9201))
        width = 3 if variant == "exact" else 1
        for ax in axes:
            line(ax, ball.t, ball.x[:, 0], color, variant, linewidth=width)
        exact = variant in ("exact", "corrected")
        close(ball.t_max, 8.5789491787288871847 if exact else 9.0304728197146180890)
        close(ball.t_max_exact, 8.5789491787288871847)
        if variant == "corrected":
            assert np.abs(ball.error.x).max() < 2.5e-3
            assert np.abs(ball.error.phi[:50]).max() < 1e-9
    axes[0].set_xlim(0, 4)
    axes[1].set_xlim(5, 9.2)
    axes[1].set_ylim(0, 0.2)
    legend(axes[0])
    axes[1].set_xlabel("t")
    for ax in axes:
        ax.set_ylabel("z")
    return figure
