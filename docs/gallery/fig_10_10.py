"""Fig. 10.10: the double pendulum above its second natural frequency, nearly localized."""

import pendulum
from drawing import np


def draw(client):
    omega = 2 / np.pi * np.sqrt(2) + 1.0
    return pendulum.draw(client, omega, 0.90687478112887, [0.1, -0.11072826223422], 0.01)
