"""What many tests take: a small class pack with known numbers, and a network that is quick to train."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vig.recognition import NetworkSettings
from vig.scene import Latents, latent_layout, point_layout

TEAPOT = Path(__file__).parent / "packs" / "teapot"
"""A pack without weights: the teapots of 0.1, with 10 components, of which many tests state numbers."""

POINT = point_layout(10)
"""The layout of a fit's points for that pack."""
LATENT_PLACES = POINT.indices(*(block.name for block in latent_layout(10).blocks))
"""Where a point has its latents."""


def points_of(latents: Latents, framing: np.ndarray | None = None) -> np.ndarray:
    """Points (B, P') of latents and framing (B, 4); further blocks are 0."""
    points = np.zeros((len(latents), POINT.size))
    points[:, LATENT_PLACES] = latents.to_vector()
    if framing is not None:
        points[:, POINT["framing"]] = framing
    return points


def run_vig(*arguments: object) -> int:
    """The exit code of `vig` with arguments, run in this process."""
    from vig_app.cli.main import main  # which sets signals up, and reads every verb

    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(str(ended.value.code or 0))


def in_this_process(
    prepare: Callable[[Any], Callable[[Any], Any]], shared: Any, items: Iterable[Any], processes: int
) -> Iterator[Any]:
    """In place of `map_in_processes`: a process takes seconds to begin."""
    return map(prepare(shared), items)


def assert_close(
    actual: np.ndarray, expected: np.ndarray, rtol: float | None = None, atol: float | None = None
) -> None:
    """Arrays of one shape and dtype are alike, by default but for rounding; NaN is like nothing."""
    assert actual.shape == expected.shape and actual.dtype == expected.dtype
    if rtol is None or atol is None:
        rtol, atol = (1.3e-6, 1e-5) if expected.dtype == np.float32 else (1e-7, 1e-7)
    np.testing.assert_allclose(actual, expected, rtol, atol, equal_nan=False)


LOW_CONTRAST = """
() => {
  const luminance = ([r, g, b]) => [[r, 0.2126], [g, 0.7152], [b, 0.0722]].reduce((sum, [c, weight]) => {
    c /= 255; return sum + weight * (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4); }, 0);
  const numbers = colour => colour.match(/[0-9.]+/g).map(Number);
  const found = [];
  for (const element of document.body.querySelectorAll("*")) {
    const own = [...element.childNodes].filter(node => node.nodeType === Node.TEXT_NODE);
    const text = own.map(node => node.data.trim()).join(" ").trim();
    const style = getComputedStyle(element);
    if (!text || !element.getClientRects().length || style.visibility === "hidden") continue;
    if (["SCRIPT", "STYLE"].includes(element.tagName)) continue;
    let behind = element, ground = [255, 255, 255];
    for (; behind; behind = behind.parentElement) {
      const colour = numbers(getComputedStyle(behind).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) { ground = colour; break; }
    }
    const [dark, light] = [luminance(numbers(style.color)), luminance(ground)].sort((a, b) => a - b);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
    const ratio = (light + 0.05) / (dark + 0.05);
    if (ratio < (large ? 3 : 4.5)) found.push(`${text.slice(0, 40)}: ${ratio.toFixed(2)}`);
  }
  return found;
}
"""
"""Script that lists the texts of a page whose contrast WCAG 2 does not allow at level AA."""

SMALL = NetworkSettings(
    channels=(4, 4, 4, 8, 8, 8), blocks=(1, 1, 1, 1, 1), expansion=2, decoder=8, squeezed=4, features=16
)


def contents(root: Path) -> dict[str, bytes]:
    """Of all files below a folder, by their paths in it."""
    return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def differing(one: dict[str, bytes], other: dict[str, bytes]) -> set[str]:
    """Names of `contents` that are not alike: comparing these themselves would print megabytes."""
    return {name for name in one.keys() | other.keys() if one.get(name) != other.get(name)}


def latents() -> Latents:
    """An explanation of the packaged teapot in float32, seen from the side under light from all round."""
    light = np.array([[2.356, *[0.1] * 8]], np.float32)
    albedo = np.array([[0.8, 0.4, 0.1]], np.float32)
    return Latents(
        np.full((1, 10), 0.5, np.float32),
        np.array([-1.0], np.float32),
        np.array([0.5], np.float32),
        albedo,
        light,
    )
