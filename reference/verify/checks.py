"""What a check is: two routes to the same numbers, and the claim that they agree.

A check is a function of a seed that returns one Comparison, or a list of them, declared with its kind:

"route"      two independent ways of computing the same quantity on one of our scenes
"physics"    a law that light keeps: energy, reciprocity, geometry, attenuation
"published"  numbers that somebody else printed; the citation says where

How many comparisons a run makes decides the significance of each, so that the whole run raises a false alarm
with at most SIGNIFICANCE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from reference.verify.agreement import Sampled

SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class Comparison:
    """first and second: the two answers, the second being the yardstick. within: see `agreement`."""

    label: str
    first: Sampled
    second: Sampled
    within: object = None


@dataclass(frozen=True)
class Check:
    """A declared check. claim: the sentence that is tested. routes: names of the two ways. scenes: names of
    the scenes that it is about, for `verify NAME`. citation: source of a published number."""

    name: str
    kind: Literal["route", "physics", "published"]
    claim: str
    routes: tuple[str, str]
    function: Callable[[int], Comparison | list[Comparison]]
    scenes: tuple[str, ...] = ()
    citation: str = ""

    def comparisons(self, seed: int) -> list[Comparison]:
        """What it compares, computed now."""
        found = self.function(seed)
        return found if isinstance(found, list) else [found]


CHECKS: dict[str, Check] = {}


def check(
    kind: Literal["route", "physics", "published"],
    *,
    claim: str,
    routes: tuple[str, str],
    scenes: tuple[str, ...] = (),
    citation: str = "",
) -> Callable:
    """Declare f(seed) -> Comparison or list of Comparisons under its own name."""

    def declare(function: Callable) -> Callable:
        CHECKS[function.__name__] = Check(function.__name__, kind, claim, routes, function, scenes, citation)
        return function

    return declare
