"""Fig. 10.5: impulse parameter over frequency, two masses of which the first is constrained."""

from drawing import close, impulses, legend, np, panels, vi

SYSTEM = vi.two_mass([vi.constraint(0, 0.2)])
P = {1.05: 0.02058396430488, 1.3: 0.20269613699682, 1.5: -0.63993096002864, 2.0: 0.13754234154401}


def draw(client):
    figure, ax = panels(size=(7, 3))
    modes = client.impact_modes(SYSTEM, (0.5, 4.0, 7001))
    impulses(ax, modes, [1.0, np.sqrt(3)], 1.2)
    ax.set_ylabel(r"impulse parameter $p_1$")
    legend(ax)
    some, p = client.impact_modes(SYSTEM, list(P)), np.array(list(P.values()))
    close(some.impulse[:, 0], p)
    np.testing.assert_array_equal(some.exists, p > 0)
    # p > 0 on (1, 1.45475), but the solution is admissible on (1, 1.42913) only.
    edge = client.impact_modes(SYSTEM, [1.42912, 1.42914])
    assert edge.exists.tolist() == [True, False]
    assert (edge.impulse > 0).all()
    ax.axvspan(1.42913, 1.45475, color="#f3d9c9")
    ax.text(1.46, 1.05, "p > 0, not admissible", fontsize=7.5)
    return figure
