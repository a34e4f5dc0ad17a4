"""Writing: two alphabets of strokes, words that can be spoken, lines and columns of text as coverage."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = np.ndarray

# Strokes of each letter through the points of a grid, three wide, five high: a b c / d e f / ... / m n o.
_CAPITALS = (
    "mgbio gi|am abfhg hlnm|cbdjno|am abflnm|camo gh|cam gh|cbdjnoih|am co gi|bn|clnj|am cg go|amo|mahco|"
    "maoc|bdjnlfb|am abfhg|bdjnlfb ko|am abfhg ho|cbdhlnm|ac bn|ajnlc|anc|amhoc|ao cm|ahc hn|acmo"
)
_SMALL = (
    "giomjl|amoig|igmo|comgi|jligmo|cbn gi|igjlom oi|am gio|hn b|hnm b|am ig go|bn|mgio hn|mgio|gmoig|"
    "mgil|oigjl|mgi|igjlom|bno gi|gmoi|gni|gmhoi|go im|gni nm|gimo"
)
_VOWELS, _CONSONANTS = (
    np.array([0, 4, 8, 14, 20]),
    np.array([1, 2, 3, 5, 6, 11, 12, 13, 15, 17, 18, 18, 19, 21]),
)
BLANK = 26


@lru_cache(maxsize=64)
def alphabet(height: int, small: bool, weight: float) -> NDArray[np.float32]:
    """Return the coverage (27, height, width) of letters a to z and a blank, each with space on the right.

    Args:
        weight: Thickness of a stroke as a share of the height.
    """
    width = max(2, round(0.5 * height))
    pen = max(weight * height, 0.9)
    y, x = np.mgrid[:height, :width] + 0.5
    reach_x, reach_y = max(width - pen, 0.5) / 2, max(height - pen, 0.5) / 4
    letters = np.zeros((27, height, width + max(1, round(0.14 * height))), np.float32)
    for number, strokes in enumerate((_SMALL if small else _CAPITALS).split("|")):
        for stroke in strokes.split():
            points = [
                (pen / 2 + reach_x * ((ord(c) - 97) % 3), pen / 2 + reach_y * ((ord(c) - 97) // 3))
                for c in stroke
            ]
            for (x0, y0), (x1, y1) in zip(points, points[1:] or points, strict=False):
                dx, dy = x1 - x0, y1 - y0
                t = np.clip(((x - x0) * dx + (y - y0) * dy) / max(dx * dx + dy * dy, 1e-9), 0, 1)
                distance = np.hypot(x - x0 - t * dx, y - y0 - t * dy)
                ink = np.clip(pen / 2 - distance + 0.5, 0, 1)
                np.maximum(letters[number, :, :width], ink, out=letters[number, :, :width])
    return letters


def word(rng: np.random.Generator, length: int) -> NDArray[np.int_]:
    """Return letters (length,) in 0 .. 25 of a word that could be spoken."""
    letters = _CONSONANTS[rng.integers(len(_CONSONANTS), size=length)]
    start = int(rng.integers(2))
    vowels = letters[start::2]
    letters[start::2] = _VOWELS[rng.integers(5, size=len(vowels))]
    return letters


def title(rng: np.random.Generator, width: int, height: int) -> NDArray[np.float32]:
    """Return the coverage (h, w) of a word in large type, at most `width` x `height` pixels."""
    length = int(rng.integers(4, 9))
    height = max(4, min(height, int(width / (0.64 * length))))
    letters = alphabet(height, rng.uniform() < 0.3, float(rng.choice([0.12, 0.17, 0.21])))
    return letters[word(rng, length)].transpose(1, 0, 2).reshape(height, -1)[:, :width]


def paragraph(
    rng: np.random.Generator, width: int, height: int, letter: int, filled: float = 0.95
) -> NDArray[np.float32]:
    """Return the coverage (height, width) of lines of small type, `letter` pixels high; ragged at right."""
    glyphs = alphabet(letter, True, 0.16)
    step = letter + max(1, round(0.5 * letter))
    lines, columns = max(1, height // step), max(1, width // glyphs.shape[2])
    text = rng.integers(26, size=(lines, columns))
    text[rng.uniform(size=text.shape) < 0.17] = BLANK
    end = np.full(lines, columns) - rng.integers(0, max(1, columns // 6), lines)
    end[rng.uniform(size=lines) > filled] //= 2
    text[np.arange(columns) >= end[:, None]] = BLANK
    rows = glyphs[text].transpose(0, 2, 1, 3).reshape(lines, letter, -1)
    page = np.zeros((max(height, lines * step), max(width, rows.shape[2])), np.float32)
    page[: lines * step].reshape(lines, step, -1)[:, :letter, : rows.shape[2]] = rows
    return page[:height, :width]
