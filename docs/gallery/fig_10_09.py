"""Fig. 10.9: the double pendulum just above its first natural frequency."""

import pendulum
from drawing import np


def draw(client):
    omega = 2 / np.pi * np.sqrt(2 / 3) + 0.1
    return pendulum.draw(client, omega, 0.32832581490184, [0.1, 0.63496702903524], 0.01)
