"""The search for the offset at which things hide a share of the object."""

import numpy as np
import pytest

from tests.support import TEAPOT
from vig.scene import ObjectClass
from vig_world.assets.models import packaged_props
from vig_world.raster.draw import depth
from vig_world.raster.items import Item
from vig_world.raster.packed import PackedAsset
from vig_world.raster.settle import ObjectPixels, settle
from vig_world.raster.view import View

TOLERANCE = 0.01


@pytest.fixture(scope="module")
def view() -> View:
    return View.of(ObjectClass.load(TEAPOT), 0.4, 0.3, 75)


def pixels_of(view: View) -> ObjectPixels:
    """A disc in the picture's middle, at the depth of the point that the camera looks at."""
    rows, columns = np.mgrid[:75, :75] + 0.5
    indices = np.flatnonzero((rows - 37.5) ** 2 + (columns - 37.5) ** 2 < 15**2)
    depths = np.full(len(indices), view.camera.distance, np.float32)
    return ObjectPixels(indices, depths, np.arange(len(indices)) % 10 == 0)


def mugs(view: View, behind: float = 0.0) -> list[Item]:
    packed = PackedAsset.of(packaged_props("train")["mug"][0].read())
    ahead = np.array([view.forward[0], view.forward[1], 0.0])
    places = (behind - 0.12) * ahead, (behind - 0.12) * ahead + [0.0, 0.0, 0.1]
    return [Item(packed, np.eye(3), place) for place in places]


def hidden_at(
    offset: float, items: list[Item], view: View, motion: np.ndarray, pixels: ObjectPixels
) -> float:
    moved = [Item(item.packed, item.rotation, item.translation + offset * motion) for item in items]
    far = depth(moved, view)[0].ravel()[pixels.indices]
    return float((pixels.hidden | (far < pixels.depths)).mean())


@pytest.mark.parametrize("level", [0.15, 0.4, 0.7])
def test_as_much_is_hidden_as_was_asked_for(view: View, level: float) -> None:
    items, pixels, motion = mugs(view), pixels_of(view), view.rotation[0]
    settled = settle(items, view, motion, (0.0, 0.3), pixels, level, TOLERANCE)
    assert not isinstance(settled, str)
    offset, far = settled
    assert abs(hidden_at(offset, items, view, motion, pixels) - level) <= TOLERANCE
    moved = [Item(item.packed, item.rotation, item.translation + offset * motion) for item in items]
    np.testing.assert_array_equal(far, depth(moved, view)[0])


@pytest.mark.parametrize(
    ("behind", "ends", "level", "reason"),
    [
        (0.0, (0.0, 0.02), 0.3, "not out of the way"),
        (0.0, (0.2, 0.3), 0.5, "too small"),
        (0.5, (0.0, 0.3), 0.3, "too small"),  # things behind the object hide nothing of it
    ],
)
def test_why_there_is_no_offset(
    view: View, behind: float, ends: tuple[float, float], level: float, reason: str
) -> None:
    assert settle(mugs(view, behind), view, view.rotation[0], ends, pixels_of(view), level, 0.01) == reason
    with_none = settle(mugs(view), view, view.rotation[0], (0.0, 0.3), pixels_of(view), 0.4, -1.0)
    assert with_none == "no offset"  # of twelve that are tried none is closer than nothing
