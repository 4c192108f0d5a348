"""Fig. 10.14: the mode of the chain just above its sixth natural frequency."""

import chain
from drawing import close, np, panels


def draw(client):
    figure, ax = panels(size=(7, 2.8))
    omega = 2 / np.pi * chain.natural(13)[5] + 0.02
    result, _, soft = chain.mode(client, 13, [5], omega, [0.05439883505872])
    close(result.shape[0, [0, 12]], [0.20150242446667, -0.18078086965525])
    chain.both(ax, result, soft, [5], 0.15)
    return figure
