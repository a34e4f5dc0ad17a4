"""The packaged mug: photos of designs, rooms and lights that its training never saw."""

import numpy as np
import pytest

from vig import Explainer
from vig.scene import Latents
from vig_world.dataset import Dataset, read_dataset
from vig_world.generation.write import make_dataset


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Photos of the test split."""
    folder = tmp_path_factory.mktemp("mugs")
    make_dataset(
        folder,
        16,
        77,
        split="test",
        workers=1,
        progress=False,
        object_class=Explainer("mug").object_class,
        photo=True,
    )
    return read_dataset(folder, "test")


def test_mugs_with_little_hidden_are_seen_from_the_right_side(photos: Dataset) -> None:
    explainer = Explainer("mug")
    clear = [number for number in range(len(photos)) if photos.occlusion[number] < 0.35]
    wholes = photos.read("mask")
    azimuths = np.rad2deg(Latents.from_vector(photos.latents).azimuth)
    off, overlap = [], []
    for number in clear:
        whole, seen = wholes[number], photos.visible[number]
        rows, columns = np.flatnonzero(whole.any(1)), np.flatnonzero(whole.any(0))
        box = (columns[0], rows[0], np.ptp(columns) + 1, np.ptp(rows) + 1)
        explanation = explainer.explain(photos.images[number], box=tuple(map(float, box)))
        turn = explanation.azimuth_deg - azimuths[number]
        off.append(abs((turn + 180) % 360 - 180))
        overlap.append((explanation.mask & seen).sum() / max((explanation.mask | seen).sum(), 1))
    assert len(clear) >= 6
    assert np.mean(np.array(off) < 30) >= 0.7
    assert np.median(overlap) > 0.8
