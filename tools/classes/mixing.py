"""Random designs as mixtures of named ones."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np

Design = TypeVar("Design")


@dataclass(frozen=True)
class Mixing:
    """Rules by which the parameters of a kind of designs are mixed.

    Attributes:
        groups: Beginnings of the names of parameters that are mixed together, a tuple for each part.
        units: (unit, lengths) pairs: lengths that are mixed as ratios to another, so that a part fits another
            body. In an order in which each unit is known before it is needed.
        lengths: All lengths that vary about their mixture.
        angles: All angles that vary about their mixture.
        whole: Parameters that no mixture changes: they are the first design's, or no group's.
        jitter: Standard deviation of each length's logarithm about its mixture's.
        angle_jitter: Standard deviation of each angle, degrees.
    """

    groups: tuple[tuple[str, ...], ...]
    units: tuple[tuple[str, tuple[str, ...]], ...]
    lengths: tuple[str, ...]
    angles: tuple[str, ...]
    whole: tuple[str, ...]
    jitter: float = 0.06
    angle_jitter: float = 4.0

    def mixture(
        self, rng: np.random.Generator, choose: Callable[[tuple[str, ...]], Sequence[Any]]
    ) -> dict[str, Any]:
        """Return a mixture of two designs of `choose(group)` for each part: parameters, lengths as ratios."""
        mixed: dict[str, Any] = {}
        for group in self.groups:
            designs = choose(group)
            first, second = (self.relative(designs[index]) for index in rng.integers(len(designs), size=2))
            weight = rng.uniform(0.5, 1.0)
            for key in first:
                if key.startswith(group):
                    other = first if key in self.whole else second
                    mixed[key] = (
                        first[key] if other is first else weight * first[key] + (1 - weight) * other[key]
                    )
        for key in self.lengths:
            mixed[key] *= np.exp(rng.normal(0.0, self.jitter))
        for key in self.angles:
            mixed[key] += rng.normal(0.0, self.angle_jitter)
        return mixed

    def relative(self, design: Any) -> dict[str, Any]:
        """Return a design's parameters, lengths that depend on the body's size as ratios."""
        d = asdict(design)
        of = {key: unit for unit, keys in self.units for key in keys}
        return {key: value / float(d[of[key]]) if key in of else value for key, value in d.items()}

    def absolute(self, relative: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parameters from ratios, the inverse of `relative`."""
        d = dict(relative)
        for unit, keys in self.units:
            for key in keys:
                d[key] = relative[key] * float(d[unit])
        return {key: _plain(value) for key, value in d.items()}


def first_sound(
    draw: Callable[[], Design], flaws: Callable[[Design], list[str]], tries: int, what: str
) -> Design:
    """Return the first of the designs drawn that has no flaws.

    Raises:
        RuntimeError: When `tries` designs in a row have flaws.
    """
    for _ in range(tries):
        design = draw()
        if not flaws(design):
            return design
    raise RuntimeError(f"{tries} drawn {what} had flaws, the last: {design}")


def drawn_in_order(
    draw: Callable[[np.random.Generator, str], Design], count: int, seed: int
) -> tuple[Design, ...]:
    """Return the first `count` random designs of a seed; a longer list begins with the shorter one."""
    return tuple(
        draw(np.random.default_rng(np.random.SeedSequence([seed, index])), f"drawn {seed}.{index}")
        for index in range(count)
    )


def _plain(value: Any) -> Any:
    return round(float(value), 5) if isinstance(value, float) else value
