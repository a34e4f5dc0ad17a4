"""Places of the map, and windows moved onto what the network sees there; with one that sees bright discs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from vig.io.errors import UserError
from vig.photo import Window
from vig.recognition import WEIGHTS_FILE, Prediction, Recognizer, find, upright
from vig.recognition.find import MOVED_WINDOWS, MOVES, box_in_window, find_several
from vig.recognition.object_map import BOX_SIDES, MAP_STRIDE
from vig.scene.object_class import PACKAGED


class SeesDiscs:
    """Predicts that bright pixels are the object, upright; its roll follows a red dot at its rim."""

    informed = has_map = True
    device = "cpu"

    def object_map(self, image: np.ndarray) -> np.ndarray:
        """Centres and boxes of bright regions of sizes that maps know."""
        numbers = np.zeros((1, 5, *(-(-side // MAP_STRIDE) for side in image.shape[2:])), np.float32)
        numbers[:, 0] = -8.0
        regions, count = ndimage.label(image[0].mean(0) > 0.5)
        for rows, columns in ndimage.find_objects(regions, count):
            size = columns.stop - columns.start, rows.stop - rows.start
            if not BOX_SIDES[0] <= max(size) <= BOX_SIDES[1]:
                continue
            x, y = ((each.start + each.stop) / 2 / MAP_STRIDE for each in (columns, rows))
            at = int(y), int(x)
            right, down, *log_size = x - at[1] - 0.5, y - at[0] - 0.5, *np.log(np.divide(size, MAP_STRIDE))
            numbers[0, :, *at] = [4.0, right, down, *log_size]
        return numbers

    def __call__(self, photos: np.ndarray, twice: bool = True) -> Prediction:
        bright = (photos.mean(-1) > 0.5).astype(np.float32)
        mask = np.stack([bright, np.zeros_like(bright), 1 - bright], -1)
        rolls = np.array([self.roll(photo) for photo in photos], np.float32)
        presence = (bright.mean((1, 2)) > 0.01).astype(np.float32)
        numbers = np.zeros((len(photos), 23), np.float32)
        azimuth = np.full((len(photos), 72), 1 / 72, np.float32)
        return Prediction(azimuth, numbers, numbers + 1, mask, rolls, presence)

    @staticmethod
    def roll(photo: np.ndarray) -> float:
        red = np.argwhere((photo[..., 0] > 0.5) & (photo[..., 2] < 0.2))
        if not len(red):
            return 0.0
        y, x = (red.mean(0) - 75).tolist()
        return math.atan2(x, -y)  # the dot is at the top of an upright disc


def disc(height: int, width: int, x: float, y: float, radius: float, angle: float = 0.0) -> np.ndarray:
    """A white disc on black with a red dot that a clockwise turn by `angle` has taken from its top."""
    rows, columns = np.mgrid[:height, :width] + 0.5
    photo = np.zeros((height, width, 3), np.float32)
    photo[(columns - x) ** 2 + (rows - y) ** 2 < radius**2] = 1.0
    dot = x + 0.8 * radius * math.sin(angle), y - 0.8 * radius * math.cos(angle)
    photo[(columns - dot[0]) ** 2 + (rows - dot[1]) ** 2 < (0.15 * radius) ** 2] = [1.0, 0.0, 0.0]
    return photo


@pytest.mark.parametrize("place", [(200.0, 150.0, 120.0), (420.0, 90.0, 50.0), (90.0, 240.0, 70.0)])
def test_the_object_is_found_at_its_place_and_size(place: tuple[float, float, float]) -> None:
    x, y, radius = place
    best = find(disc(320, 500, x, y, radius), SeesDiscs())  # type: ignore[arg-type]
    assert best.window.side == pytest.approx(1.4 * 2 * radius, rel=0.12)
    assert best.window.centre == pytest.approx((x, y), abs=0.15 * radius)
    assert best.present > 0.5


def test_what_is_unlikely_beside_the_best_is_not_looked_at() -> None:
    """A place with a tenth of the probability is looked at, one with less is not."""

    class Counts(SeesDiscs):
        seen = 0
        second = 0.0

        def __call__(self, photos: np.ndarray, twice: bool = True) -> Prediction:
            self.seen += len(photos)
            return super().__call__(photos, twice)

        def object_map(self, image: np.ndarray) -> np.ndarray:
            numbers = super().object_map(image)
            numbers[0, 0, 0, 0] = math.log(self.second / (1 - self.second))
            return numbers

    for second, looks in ((0.05, MOVES), (0.5, MOVES * MOVED_WINDOWS)):
        counts = Counts()
        counts.second = second
        find(disc(300, 300, 190, 190, 90), counts)  # type: ignore[arg-type]
        assert counts.seen == looks


def test_the_presence_falls_with_the_share_of_the_object_of_which_the_network_is_unsure() -> None:
    """Where it gives .7 to each pixel, 3 / 7 of the object are expected to be wrong; of a sharp mask a
    thousandth, the least that counts. All else is the same.
    """

    class Unsure(SeesDiscs):
        def __call__(self, photos: np.ndarray, twice: bool = True) -> Prediction:
            seen = super().__call__(photos, twice)
            bright = 0.7 * seen.mask[..., 0]
            return replace(seen, mask=np.stack([bright, np.zeros_like(bright), 1 - bright], -1))

    photo = disc(300, 300, 190, 190, 90)
    sure, unsure = (find(photo, seeing).present for seeing in (SeesDiscs(), Unsure()))  # type: ignore[arg-type]
    apart = math.log(sure / (1 - sure)) - math.log(unsure / (1 - unsure))
    assert apart == pytest.approx(math.log(3 / 7 / 1e-3), rel=1e-3)


@pytest.fixture(scope="module")
def teapot() -> Recognizer:
    return Recognizer(PACKAGED / "teapot" / WEIGHTS_FILE)


@pytest.mark.parametrize("size", [(30, 4000), (4000, 30), (40, 16)])
def test_narrow_photos_have_places_or_none(size: tuple[int, int], teapot: Recognizer) -> None:
    photo = np.zeros((*size, 3), np.float32)
    assert find(photo, SeesDiscs()).present == 0  # type: ignore[arg-type]
    assert find(photo, teapot).present < 0.5 and not find_several(photo, SeesDiscs(), 2)  # type: ignore[arg-type]


def test_a_network_without_a_map_asks_for_a_box() -> None:
    class HasNone(SeesDiscs):
        has_map = False

    photo = disc(300, 300, 150, 150, 90)
    with pytest.raises(UserError, match="no map to find objects"):
        find(photo, HasNone())  # type: ignore[arg-type]
    with pytest.raises(UserError, match="no map to find objects"):
        find_several(photo, HasNone(), 2)  # type: ignore[arg-type]


def test_each_of_several_is_found_once() -> None:
    photo = disc(320, 500, 130, 150, 70)
    other = disc(320, 500, 390, 170, 80)
    found = find_several(np.maximum(photo, other), SeesDiscs(), 3)  # type: ignore[arg-type]
    assert sorted(each.window.centre[0] for each in found) == pytest.approx([130, 390], abs=12)


@pytest.mark.parametrize("angle", [0.0, 0.3, -0.5])
def test_a_window_is_turned_upright(angle: float) -> None:
    photo = disc(300, 300, 150, 150, 80, angle)
    turned = upright(photo, Window(38, 38, 224), SeesDiscs())  # type: ignore[arg-type]
    assert turned.roll == pytest.approx(angle, abs=0.1)
    assert turned.side == 224


def test_a_window_is_turned_on_where_only_a_part_of_a_roll_is_seen() -> None:
    class SeesHalf(SeesDiscs):
        looks = 0

        @classmethod
        def roll(cls, photo: np.ndarray) -> float:
            cls.looks += 1
            return 0.6 * SeesDiscs.roll(photo)

    photo = disc(300, 300, 150, 150, 80, 0.6)
    turned = upright(photo, Window(38, 38, 224), SeesHalf())  # type: ignore[arg-type]
    assert turned.roll == pytest.approx(0.6 * (1 - 0.4**2), abs=0.04)
    assert SeesHalf.looks == 3, "the third sees less than 5 degrees"


def test_the_box_of_what_is_seen_is_in_sides_of_the_window() -> None:
    photo = np.zeros((1, 150, 150, 3), np.float32)
    photo[:, 30:90, 15:135] = 1.0
    assert box_in_window(SeesDiscs()(photo)) == pytest.approx((0.1, 0.2, 0.8, 0.4))
    assert box_in_window(SeesDiscs()(np.zeros((1, 150, 150, 3), np.float32))) is None
