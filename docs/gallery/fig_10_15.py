"""Fig. 10.15: modes at the internal resonances of the parts left and right of the sixth mass."""

import chain
from drawing import close, np, panels

CASES = (  # omega, p, largest displacement and its mass, eq. 10.75 and 10.76
    (1.22985, 1.53200170049721, 6.12704583918772, 3, 2 * np.sin(5 * np.pi / 12)),
    (1.24877, 1.57076393722139, -8.21090950538377, 10, 2 * np.sin(7 * np.pi / 16)),
)


def draw(client):
    figure, axes = panels(2, 1, (7, 5.5))
    for ax, (omega, p, largest, mass, resonance) in zip(axes, CASES, strict=True):
        assert abs(2 / np.pi * resonance - omega) < 1e-5
        result, _, soft = chain.mode(client, 13, [5], omega, [p], alpha=0.968)
        close(result.shape[0, mass - 1], largest)
        chain.both(ax, result, soft, [5], 0.1)
    return figure
