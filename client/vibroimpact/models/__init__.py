"""Finite-element models: matrices with the labels and coordinates of their nodes.

Needs scipy:  ``pip install 'vibroimpact[models]'``.
"""

from vibroimpact.models.model import Model
from vibroimpact.models.readers import read_model
from vibroimpact.models.reduction import Reduction, condense, reduce

__all__ = ["Model", "Reduction", "condense", "read_model", "reduce"]
