"""The plan of a computation, readable as text and in notebooks."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

from vibroimpact.tables import html_table

if TYPE_CHECKING:
    from vibroimpact import documents


class Plan(dict[str, Any]):
    """The steps of a computation and those it skips: the plan document of the service."""

    @property
    def steps(self) -> list[documents.PlanStep]:
        """What is done, in order: stage, method, reason, cost."""
        steps: list[documents.PlanStep] = self["steps"]
        return steps

    @property
    def skips(self) -> list[documents.PlanSkip]:
        """What is not computed, and why."""
        skips: list[documents.PlanSkip] = self["skips"]
        return skips

    @property
    def seconds(self) -> float:
        """Estimated time of computing."""
        return float(self["seconds"])

    def __str__(self) -> str:
        """Return steps, skipped steps and cost, one line each."""
        lines = [f"{s['stage']}: {s['method']} – {s['reason']}" for s in self["steps"]]
        lines += [f"skipped: {s['what']} – {s['why']}" for s in self["skips"]]
        return "\n".join([*lines, self._cost()])

    __repr__ = __str__

    def _cost(self) -> str:
        if self["cached"]:
            return "the result is already stored"
        how = "answered directly" if self["inline"] else "run as a job"
        return f"about {self['seconds']:.2g} s of computation, {how}"

    def _repr_html_(self) -> str:
        steps = [[s["stage"], s["method"], str(s["count"]), s["reason"]] for s in self["steps"]]
        skips = [["–", s["what"], "", s["why"]] for s in self["skips"]]
        table = html_table(["stage", "method", "count", "reason"], steps + skips)
        return f"<p>{html.escape(self._cost())}</p>{table}"
