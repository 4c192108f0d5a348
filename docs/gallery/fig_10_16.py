"""Fig. 10.16: localization above all resonances, the split chain, and soft limiters."""

import chain
from drawing import BLUE, OTHER, SOFT, close, legend, line, np, panels, profile

OMEGA = 1.34877


def split(a=6, n=13, gap=0.2, terms=200):
    """Return the profile at tau = 1 of eq. 10.71-10.74; gamma = sqrt(2)/omega is not printed."""
    gamma, Omega = np.sqrt(2) / OMEGA, np.pi / 2 * OMEGA
    odd = 2 * np.arange(1, terms + 1) - 1.0
    # sin((2 s - 1) pi/2) cancels the sign of b_s, eq. 10.69.
    b = 8 * gamma / np.tan(gamma) / (odd**2 * np.pi**2 - 4 * gamma**2)
    profiles = []
    for size in (a - 1, n - a):
        j = np.arange(1, size + 1)
        squares = 4 * np.sin(np.pi * j / (2 * (size + 1))) ** 2
        e = np.sqrt(2 / (size + 1)) * np.sin(np.pi * np.outer(j, j) / (size + 1))
        q = e[:, -1] * gap * np.sum(b / (squares[:, None] - (odd * Omega) ** 2), axis=1)
        profiles.append(e.T @ q)
    return np.concatenate([profiles[0], [gap], profiles[1][::-1]])


def draw(client):
    figure, axes = panels(2, 1, (7, 5.5))
    result, motion, soft = chain.mode(
        client, 13, [5], OMEGA, [0.13723969271483], quarter=5, alpha=0.968
    )
    chain.both(axes[0], result, soft, [5], 0.15)
    parts = split()
    np.testing.assert_allclose(parts[[0, 12]], [-4.27561672260665e-3, -1.08503928119176e-3], 1e-4)
    assert np.abs(parts - result.shape[0]).max() < 4.4e-3
    profile(axes[0], parts, None, "split chain, 10.73", OTHER, "+")
    legend(axes[0])
    # "About 6 %": 8.0 % above the highest resonance 10.76, 6.6 % above Omega_13.
    highest = 2 / np.pi * 2 * np.sin(7 * np.pi / 16)
    close(OMEGA / highest - 1, 0.0801, 2e-3)
    line(axes[1], motion.t, (motion.x[:, 5] / (0.968 * 0.2)) ** 17, SOFT, linestyle="-")
    for impact in np.arange(1, 6, 2) / OMEGA:
        axes[1].axvline(impact, color=BLUE, linewidth=0.8)
    axes[1].set_xlabel("t; lines: impacts of the mode")
    axes[1].set_ylabel("force of the soft limiter")
    return figure
