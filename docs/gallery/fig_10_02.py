"""Fig. 10.2: an admissible solution and a phantom of the oscillator between walls, E = 1.2 E*."""

from drawing import BLUE, PHANTOM, WALL, close, np, panels, say, vi

SYSTEM = vi.oscillator([vi.constraint(0, 1.0)])


def draw(client):
    figure, axes = panels(1, 2, (7, 2.6))
    for root, ax, name in ((0, axes[0], "admissible"), (1, axes[1], "phantom")):
        solution = client.slow_flow(
            SYSTEM, "oscillator", "family", {"energy": 0.6, "root": root}, (0, 12, 2401),
            outputs=("state", "x", "impulse"),
        )  # fmt: skip
        gamma, x = solution.gamma[0], solution.x[:, 0]
        ax.plot(solution.t, x, color=BLUE if root == 0 else PHANTOM)
        ax.hlines([-1, 1], 0, 12, color=WALL)
        say(ax, rf"{name}, $\gamma$ = {gamma:.4f}, p = {solution.impulse[0]:.4f}")
        ax.set_xlabel("t")
        ax.set_ylim(-1.25, 1.25)
        if root == 0:
            assert solution.exists
            close(gamma, 1.1502619915109314913)
            close(solution.impulse[0], 0.38879281311600901838)
            assert np.abs(x).max() <= 1 + 1e-14
        else:
            assert not solution.exists
            close(gamma, 1.9913306620788617472)
            close(solution.impulse[0], -0.2245802789141440670)
            close(np.abs(x).max(), 1.0954451150103322269, 1e-5)
    axes[0].set_ylabel("x")
    return figure
