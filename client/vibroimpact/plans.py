"""A plan as people read it: what will be done and left out, and why."""

from __future__ import annotations

import html
from typing import Any


class Plan(dict[str, Any]):
    """What would be computed and skipped: the document of the service, readable."""

    def __str__(self) -> str:
        """Return steps, skips and cost, a line each."""
        lines = [f"{s['stage']}: {s['method']} – {s['reason']}" for s in self["steps"]]
        lines += [f"not: {s['what']} – {s['why']}" for s in self["skips"]]
        return "\n".join([*lines, self._cost()])

    def _cost(self) -> str:
        if self["cached"]:
            return "the result is there already"
        how = "answered at once" if self["inline"] else "becomes a job"
        return f"about {self['seconds']:.2g} s of computing, {how}"

    def _repr_html_(self) -> str:
        steps = [(s["stage"], s["method"], s["count"], s["reason"]) for s in self["steps"]]
        skips = [("–", s["what"], "", s["why"]) for s in self["skips"]]
        rows = "".join(
            "<tr>" + "".join(f"<td style='text-align:left'>{html.escape(str(c))}</td>" for c in row)
            + "</tr>"
            for row in [*steps, *skips]
        )  # fmt: skip
        head = "<tr><th>stage</th><th>what</th><th>how often</th><th>why</th></tr>"
        return f"<p>{html.escape(self._cost())}</p><table><thead>{head}</thead>{rows}</table>"
