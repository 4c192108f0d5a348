"""What can be wrong with a store, whatever it is."""

from __future__ import annotations


class StoreFullError(OSError):
    """The store has no room for another block."""


class StoreUnavailableError(ConnectionError):
    """The store cannot be reached, cannot be read or written at the moment, or refuses."""
