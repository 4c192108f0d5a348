"""Fig. 10.18: the profile of two masses striking together, after one cycle."""

import chain
from drawing import close, np, panels


def draw(client):
    figure, ax = panels(size=(7, 2.8))
    omega = 2 / np.pi * chain.natural(12)[8] + 0.02
    p = [0.27439611800597, 0.37856420641731]
    result, _, soft = chain.mode(client, 12, [4, 8], omega, p, quarter=5)
    close(result.shape[0, [0, 6]], [-0.12741621054822, -0.68400928842393])
    chain.both(ax, result, soft, [4, 8], 0.3)
    return figure
