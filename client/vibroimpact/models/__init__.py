"""Finite-element models: matrices with the labels and coordinates of their nodes.

Needs scipy:  ``pip install 'vibroimpact[models]'``.
"""

from vibroimpact.models.comparison import Comparison
from vibroimpact.models.label_files import read_nodes
from vibroimpact.models.model import Model
from vibroimpact.models.nodes import Nodes
from vibroimpact.models.readers import read_model
from vibroimpact.models.reduced import Reduction
from vibroimpact.models.reduced_model import ReducedModel
from vibroimpact.models.reduction import condense, reduce

__all__ = [
    "Comparison",
    "Model",
    "Nodes",
    "ReducedModel",
    "Reduction",
    "condense",
    "read_model",
    "read_nodes",
    "reduce",
]
