"""Imported first by the process from which workers are forked: who ends them is the service alone.

A terminal sends Ctrl-C to all processes, systemd and SLURM send SIGTERM. The service ends its
workers when they have stopped what they compute; by themselves they would print where they were
interrupted, and be started again.
"""

from __future__ import annotations

import signal

for _each in (signal.SIGINT, signal.SIGTERM):
    signal.signal(_each, signal.SIG_IGN)
