"""Fig. 10.17: impulses of two masses that strike together, the fifth and ninth of twelve."""

import chain
from drawing import OTHER, close, impulses, legend, np, panels, vi

# The distances are not printed; equal ones are assumed.
SYSTEM = vi.chain(12, [vi.constraint(4, 0.2), vi.constraint(8, 0.2)])
P = {
    1.5: (0.19750683745055, -0.33476791459290, False),
    1.6: (0.44303515293216, -0.03138891678949, False),
    1.75: (0.12334662657403, 0.20914132350934, True),
    2.0: (0.01983176940860, 0.02455774990074, True),
    2.5: (0.32691553303908, 0.32691963789557, True),
}


def draw(client):
    figure, ax = panels(size=(7, 3))
    modes = client.impact_modes(SYSTEM, (1.0, 2.4, 7001))
    natural = chain.natural(12)[4:]
    impulses(ax, modes, natural, 1.0, 0, label=r"$p_5$")
    impulses(ax, modes, natural, 1.0, 1, OTHER, r"$p_9$")
    ax.set_ylabel("impulse parameters")
    legend(ax)
    result = client.impact_modes(SYSTEM, list(P))
    close(result.impulse, [row[:2] for row in P.values()], 1e-11)
    assert result.exists.tolist() == [row[2] for row in P.values()]
    # Both positive and admissible just above Omega_9, "the fifth red dot".
    near = client.impact_modes(SYSTEM, natural[4] + np.array([0.005, 0.02, 0.04]))
    assert near.exists.all()
    return figure
