"""Masks as tools write them, and the names that they give them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig.photo.masks import bop_box, box_of, coco_region, mask_files, read_mask

TRUE = np.zeros((40, 60), bool)
TRUE[10:30, 20:50] = True
BYTES = TRUE.astype(np.uint8)


def palette(values: np.ndarray, colours: list[int]) -> Image.Image:
    image = Image.fromarray(values, "P")
    image.putpalette(colours + [0] * (768 - len(colours)))
    return image


def cut_out(alpha: np.ndarray) -> Image.Image:
    """A photo of the object, transparent elsewhere, as background removers save it."""
    picture = np.random.default_rng(0).integers(0, 255, (*TRUE.shape, 3), np.uint8)
    return Image.fromarray(np.dstack([picture, alpha]))


def edges() -> np.ndarray:
    grown = TRUE.astype(np.float32)
    for axis in (0, 1):
        grown = (np.roll(grown, 1, axis) + grown + np.roll(grown, -1, axis)) / 3
    return (255 * grown).round().astype(np.uint8)


KINDS: dict[str, Callable[[], Image.Image]] = {
    "0 and 255": lambda: Image.fromarray(255 * BYTES),
    "0 and 1": lambda: Image.fromarray(BYTES),
    "0 and 7": lambda: Image.fromarray(7 * BYTES),
    "bilevel": lambda: Image.fromarray(TRUE),
    "sixteen bits": lambda: Image.fromarray(65535 * BYTES.astype(np.uint16)),
    "sixteen bits, 0 and 1": lambda: Image.fromarray(BYTES.astype(np.uint16)),
    "a palette": lambda: palette(BYTES, [0, 0, 0, 128, 0, 0]),
    "a palette, other numbers": lambda: palette(
        5 - 3 * BYTES, [9, 9, 9, 9, 9, 9, 255, 255, 255, 0, 0, 0] + [0] * 6
    ),
    "red": lambda: Image.fromarray(BYTES[..., None] * np.uint8([200, 0, 0])),
    "opaque": lambda: Image.fromarray(np.dstack([255 * BYTES] * 3 + [np.full_like(BYTES, 255)])),
    "white, transparent": lambda: Image.fromarray(np.dstack([np.full_like(BYTES, 255)] * 3 + [255 * BYTES])),
    "both": lambda: Image.fromarray(np.dstack([255 * BYTES] * 4)),
    "grey and alpha": lambda: Image.fromarray(np.dstack([np.full_like(BYTES, 99), 255 * BYTES]), "LA"),
    "a cut-out": lambda: cut_out(255 * BYTES),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_mask_of_any_usual_kind_is_what_it_means(kind: str, tmp_path: Path) -> None:
    KINDS[kind]().save(tmp_path / "mask.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png"), TRUE)


def test_a_mask_with_shades_is_the_same_but_for_its_edge(tmp_path: Path) -> None:
    Image.fromarray(edges()).save(tmp_path / "mask.png")
    assert (read_mask(tmp_path / "mask.png") != TRUE).sum() == 4  # the corners, of which 4 / 9 are left
    Image.fromarray(255 * BYTES).save(tmp_path / "mask.jpg", quality=60)
    assert (read_mask(tmp_path / "mask.jpg") != TRUE).sum() <= 4


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (Image.fromarray(BYTES + np.roll(BYTES, 9, 0)), "the numbers 0, 1, 2"),
        (Image.fromarray((BYTES + 2 * np.roll(BYTES, 9, 0)).astype(np.uint16)), "the numbers"),
        (palette(BYTES + np.roll(BYTES, 9, 0), [0, 0, 0, 128, 0, 0, 0, 128, 0]), "2 colours"),
        (Image.fromarray(BYTES + np.uint8(1)), "the numbers 1, 2"),
        (Image.fromarray(np.dstack([255 * BYTES] * 3 + [np.roll(255 * BYTES, 9, 0)])), "different things"),
    ],
)
def test_a_mask_that_says_several_things_is_refused(picture: Image.Image, words: str, tmp_path: Path) -> None:
    picture.save(tmp_path / "mask.png")
    with pytest.raises(UserError, match=f"expected a mask.*{words}") as caught:
        read_mask(tmp_path / "mask.png")
    assert "\n" not in str(caught.value)


def test_a_masks_box_and_that_of_an_empty_one() -> None:
    assert box_of(TRUE) == (20, 10, 30, 20)
    assert box_of(np.zeros((4, 4), bool)) is None


def test_bops_box_is_the_first_pixel_and_the_distance_to_the_last_and_cocos_a_pixel_more() -> None:
    """Two pixels side by side at columns 5 and 6: width 1, as BOP's toolkit computes it, and 2."""
    mask = np.zeros((10, 10), bool)
    mask[3, 5:7] = True
    assert bop_box(mask) == [5, 3, 1, 0]
    assert bop_box(mask, (-10, -10)) == [-5, -7, 1, 0]
    assert bop_box(np.zeros((3, 3), bool)) == [-1, -1, -1, -1]
    region = coco_region(mask)
    assert region["bbox"] == [5, 3, 2, 1] and region["area"] == 2
    assert coco_region(np.zeros((3, 3), bool))["bbox"] == [0, 0, 0, 0]


@pytest.mark.parametrize(
    "name",
    ["7.png", "7.jpg", "7.jpg.png", "7_mask.png", "mask_7.tif", "7_000000.png", "rgb/7.png", "b/rgb/7.png"],
)
def test_a_masks_file_is_found_by_the_names_that_tools_give(name: str, tmp_path: Path) -> None:
    photo = tmp_path / "photos" / "b" / "rgb" / "7.jpg"
    mask = tmp_path / "masks" / name
    mask.parent.mkdir(parents=True)
    mask.write_bytes(b"")
    assert mask_files(tmp_path / "masks", [photo]) == [mask]


def test_bops_masks_of_several_objects_and_none_are_told(tmp_path: Path) -> None:
    for number in range(2):
        (tmp_path / f"000007_{number:06}.png").write_bytes(b"")
    with pytest.raises(UserError, match="expected one mask of 000007.jpg; got 2, 000007_000000.png"):
        mask_files(tmp_path, [Path("000007.jpg")])
    assert mask_files(tmp_path, [Path("8.jpg")]) == [tmp_path / "8.png"]
