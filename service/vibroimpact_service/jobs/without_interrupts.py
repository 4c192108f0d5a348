"""Imported first by the process from which workers are forked: Ctrl-C is for the service alone.

A terminal sends it to all processes. The service ends the others; by themselves they would print
where each of them was interrupted.
"""

from __future__ import annotations

import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
