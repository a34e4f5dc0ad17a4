"""What a picture says of the object in it: how much is hidden, and by what."""

import numpy as np
import pytest

from vig_world.raster.picture import Picture


def picture(visible: int, amodal: int, canvas: int, by_support: int = 0) -> Picture:
    """A picture whose masks have so many pixels; those hidden by the room come last of the amodal ones."""

    def first(count: int, size: int = 10, skip: int = 0) -> np.ndarray:
        mask = np.zeros(size * size, dtype=bool)
        mask[skip : skip + count] = True
        return mask.reshape(size, size)

    return Picture(
        image=np.zeros((10, 10, 3), np.uint8),
        depth=np.ones((10, 10), np.float32),
        amodal=first(amodal),
        visible=first(visible),
        by_support=first(by_support, skip=amodal - by_support),
        canvas=first(canvas, size=30),
        light=np.ones(9, np.float32),
    )


def test_occlusion_is_the_share_of_the_pixels_within_the_frame() -> None:
    """30 of 40 pixels are seen, whatever the frame cuts off."""
    assert picture(30, 40, canvas=40).occlusion == pytest.approx(1 - 30 / 40)
    assert picture(30, 40, canvas=80).occlusion == pytest.approx(1 - 30 / 40)
    assert picture(40, 40, canvas=80).occlusion == 0


def test_shares_are_of_the_whole_object_and_add_up_to_what_is_not_seen() -> None:
    """Of 80 pixels 40 are outside; of the other 40, 14 are hidden, 10 of these by the room."""
    shares = picture(26, 40, canvas=80, by_support=10).shares
    assert shares == pytest.approx({"occluder": 4 / 80, "support": 10 / 80, "truncation": 40 / 80})
    assert sum(shares.values()) == pytest.approx(1 - 26 / 80)


@pytest.mark.parametrize(
    ("numbers", "cause"),
    [((40, 40, 40, 0), "none"), ((26, 40, 40, 10), "support"), ((26, 40, 40, 6), "occluder")],
)
def test_the_cause_is_what_hides_most(numbers: tuple[int, int, int, int], cause: str) -> None:
    assert picture(*numbers).cause == cause
    assert picture(26, 40, canvas=80).cause == "truncation"
