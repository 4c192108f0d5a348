"""Segments of a sign band: ranges of q = 1/omega that are decided or not, and their edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from vibroimpact_solvers.kernels import bands


@dataclass(frozen=True, slots=True)
class Segment:
    """A range of q = 1/omega inside a sign band, decided or not."""

    left: float
    right: float
    status: int  # as in `kernels.bands`
    witness: float
    limit: int
    # Absolute errors of the ends
    left_error: float = 0.0
    right_error: float = 0.0
    certified: bool = True


@dataclass(frozen=True, slots=True)
class SignBand:
    """A range of q from a zero of the response to its next pole: the impulse is positive."""

    zero: float
    pole: float
    # Absolute errors
    zero_error: float
    pole_error: float
    segments: Sequence[Segment] = ()


def closed(band: SignBand) -> list[Segment]:
    """Return the decided segments of a sign band, extended over the undecided ones.

    Between unlike segments the edge is put in the middle of the undecided one; like segments are
    joined and no longer certified; at the end of the sign band the neighbour is extended.
    """
    decided: list[Segment] = []
    gap: Segment | None = None
    for segment in band.segments:
        if segment.status == bands.UNDECIDED:
            gap = segment
            continue
        width = 0.0 if gap is None else gap.right - gap.left
        if gap is not None and decided and decided[-1].status == segment.status:
            left, error = decided[-1].left, decided.pop().left_error
            segment = replace(segment, left=left, left_error=error, certified=False)
        elif gap is not None and decided:
            middle, half = gap.left + 0.5 * width, 0.5 * width
            decided[-1] = replace(decided[-1], right=middle, right_error=half)
            segment = replace(segment, left=middle, left_error=half)
        elif gap is not None:
            segment = replace(segment, left=gap.left, left_error=width)
        gap = None
        decided.append(segment)
    if gap is not None and decided:
        decided[-1] = replace(decided[-1], right=gap.right, right_error=gap.right - gap.left)
    return [_with_ends(segment, band) for segment in decided]


def _with_ends(segment: Segment, band: SignBand) -> Segment:
    """Add the errors of the ends of the sign band."""
    if segment.left == band.zero:
        segment = replace(segment, left_error=segment.left_error + band.zero_error)
    if segment.right == band.pole:
        segment = replace(segment, right_error=segment.right_error + band.pole_error)
    return segment
