"""Fig. 10.13: the chain of 13 masses, the sixth between walls: p over Omega, and one mode."""

import chain
from drawing import close, impulses, legend, np, panels, vi

SYSTEM = vi.chain(13, [vi.constraint(5, 0.2)])
# Poles of p, zeros of the sum in eq. 10.66.
POLES = [1.02658790546693, 1.13376631821069, 1.43845931840541]


def draw(client):
    figure, axes = panels(2, 1, (7, 5.5))
    Omega = chain.natural(13)
    modes = client.impact_modes(SYSTEM, (0.6, 2.4, 6001))
    impulses(axes[0], modes, Omega[2:], 1.0)
    axes[0].set_ylabel(r"impulse parameter $p_6$")
    legend(axes[0])
    for pole in POLES:
        pair = client.impact_modes(SYSTEM, [pole - 1e-9, pole + 1e-9])
        assert (np.abs(pair.impulse) > 1e5).all()
        assert pair.impulse[0, 0] * pair.impulse[1, 0] < 0
    omega = 2 / np.pi * Omega[4] + 0.02
    result, _, soft = chain.mode(client, 13, [5], omega, [0.2346217395232693])
    close(result.shape[0, 0], 0.14069688839403216)
    chain.both(axes[1], result, soft, [5], 0.05)
    return figure
