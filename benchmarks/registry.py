"""The benchmarks, each a page of the documentation, and the functions that measure their tables.

To add a table: write a function in this folder that takes nothing and returns a `tables.Table`,
with a docstring that says what is measured; `harness.measure` does the timing. List the function
below. Modules are imported only when they run, so that a peer that is not installed hinders
no other table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from typing import Final

from benchmarks.tables import Table


@dataclass(frozen=True, slots=True)
class Part:
    """A table of a benchmark, by module and name of the function that measures it."""

    benchmark: str
    path: str

    @property
    def name(self) -> str:
        """Name of the function."""
        return self.path.rpartition(".")[2]

    @property
    def label(self) -> str:
        """Name on the command line."""
        return f"{self.benchmark}.{self.name}"

    def function(self) -> Callable[[], Table]:
        """Return the function.

        Raises
        ------
        ImportError
            Where something that it needs is not installed.
        """
        module, _, name = self.path.rpartition(".")
        function: Callable[[], Table] = getattr(import_module(module), name)
        return function


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A page of the documentation, and the functions in `benchmarks` that measure its tables."""

    name: str
    title: str
    shows: str
    paths: tuple[str, ...]

    @property
    def parts(self) -> tuple[Part, ...]:
        """Its tables."""
        return tuple(Part(self.name, f"benchmarks.{path}") for path in self.paths)


BENCHMARKS: Final[tuple[Benchmark, ...]] = (
    Benchmark(
        "defaults",
        "Default requests",
        "what a user gets by default: one call from Python and over HTTP, each kind on beams, "
        "and on a plate, a frame and a solid",
        ("defaults.calls", "defaults.kinds", "defaults.finite_elements"),
    ),
    Benchmark(
        "peers",
        "Against other programs",
        "time histories against heyoka, SUNDIALS, diffrax, scipy and Siconos; impact modes "
        "against numpy",
        (
            "peers.ahead.ahead",
            "peers.outputs.outputs",
            "peers.stops.stops",
            "peers.ahead.rest",
            "error_against_time.impact_modes.against_numpy",
        ),
    ),
    Benchmark(
        "error-against-time",
        "Error against time",
        "run time and error of every method, from loose to tight tolerances",
        (
            "error_against_time.time_histories.time_histories",
            "error_against_time.stated_errors.stated_errors",
            "error_against_time.impact_modes.impulses",
            "error_against_time.existence_bands.bands_by_scans",
            "error_against_time.existence_bands.bands_of_beams",
            "error_against_time.slow_flows.slow_flow_variants",
        ),
    ),
    Benchmark(
        "skips",
        "Skips",
        "the time that plans save by what they leave out",
        ("skips.saved",),
    ),
    Benchmark(
        "scaling",
        "Scaling",
        "cost against size, frequencies, impacts and threads; memory; large structures; large "
        "models from files",
        (
            "scaling.size",
            "scaling.modes",
            "scaling.frequencies",
            "scaling.impacts",
            "scaling.threads",
            "memory.memory",
            "scaling.large",
            "large_models.large_models",
        ),
    ),
    Benchmark(
        "periodic-motions",
        "Periodic motions",
        "responses, multipliers and branches of driven structures; against shooting with heyoka",
        (
            "periodic_motions.responses",
            "periodic_motions.defaults",
            "periodic_motions.default_branches",
            "periodic_motions.default_attractors",
            "periodic_motions.following",
            "periodic_motions.shooting",
        ),
    ),
    Benchmark(
        "service",
        "Service",
        "answers over HTTP, more and more clients, small jobs and a cold start",
        (
            "service.answers.answers",
            "service.answers.clients",
            "service.jobs.small_jobs",
            "service.jobs.sweeps",
            "service.jobs.beams_in_a_sweep",
            "service.answers.starts",
        ),
    ),
    Benchmark(
        "bounds",
        "Lower bounds",
        "time of the kernels that matter over the least that the hardware allows",
        ("bounds.bounds",),
    ),
)


def named(names: Sequence[str]) -> list[Part]:
    """Return the tables of those names, all for none.

    Parameters
    ----------
    names : sequence of str
        Such as ``scaling``, or ``scaling.memory`` for one of its tables.

    Raises
    ------
    ValueError
        Where there is no such benchmark or table.
    """
    pages = [one.name for one in BENCHMARKS]
    every = [part for one in BENCHMARKS for part in one.parts]
    chosen: dict[Part, None] = {}
    for name in names or pages:
        parts = [part for part in every if name in (part.benchmark, part.label)]
        if not parts:
            known = [part.label for part in every] if "." in name else pages
            near = get_close_matches(name, known) or pages
            raise ValueError(f"No benchmark is called {name}. There is: {', '.join(near)}.")
        chosen |= dict.fromkeys(parts)
    return list(chosen)
