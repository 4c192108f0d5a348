"""Fig. 10.8: impulse parameter of the double pendulum, mu = 2, limits +-0.1."""

from drawing import close, impulses, legend, np, panels, vi

SYSTEM = vi.double_pendulum([vi.constraint(0, 0.1)], mu=2.0)
P = {0.85: 0.03506514842022, 1.0: 0.56845722253134, 1.2: -0.17853866229629, 4.0: 1.77349543865192}


def draw(client):
    figure, ax = panels(size=(7, 3))
    modes = client.impact_modes(SYSTEM, (0.5, 3.0, 5001))
    impulses(ax, modes, [np.sqrt(2 / 3), np.sqrt(2)], 1.2)
    ax.set_ylabel(r"impulse parameter $p_1$")
    legend(ax)
    some, p = client.impact_modes(SYSTEM, list(P)), np.array(list(P.values()))
    close(some.impulse[:, 0], p)
    np.testing.assert_array_equal(some.exists, p > 0)
    return figure
