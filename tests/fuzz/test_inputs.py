"""Damaged masks, cameras and boxes: a mask, a camera or a box of each photo, or one line."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.fuzz.mutations import damaged, damaged_json, outcomes, read_damaged
from vig.photo import Intrinsics
from vig.photo.masks import read_mask
from vig_app.cli.boxes import boxes_of
from vig_app.cli.cameras import cameras_of
from vig_app.cli.options import CameraOptions, HintOptions, PlaceOptions

COUNT = int(os.environ.get("VIG_FUZZ", "100"))
"""Mutants of each kind."""


def test_damaged_masks(tmp_path: Path) -> None:
    path, mask = tmp_path / "mask.png", np.zeros((40, 60), np.uint8)
    mask[10:30, 20:40] = 255
    Image.fromarray(np.dstack([mask] * 4)).save(path)

    def read(path: Path) -> None:
        found = read_mask(path)
        assert found.dtype == bool and found.ndim == 2

    read_damaged(path, damaged, read, COUNT, 3, COUNT // 10)


BOXES = [{"7.png": [10, 20, 30, 40], "8.png": [{"box": [1, 2, 30, 40], "class": "mug"}]}]
K = [900, 0, 310, 0, 880, 250, 0, 0, 1]
CAMERAS = [
    {"7": {"cam_K": K}, "8": [900, 880, 310, 250]},
    {"a/7.png": {"K": K, "D": [0, 0], "width": 640, "height": 480}, "7.png": [900, 880, 310, 250]},
    {"camera_matrix": {"rows": 3, "data": K}, "distortion": {"k1": 0, "data": [0]}, "resolution": [640, 480]},
    {"camera_model": "OPENCV", "params": [900, 880, 310, 250, 0], "image_width": 640, "image_height": 480},
]


@pytest.mark.parametrize("kind", ["boxes", "cameras"])
def test_damaged_cameras_and_boxes(kind: str, tmp_path: Path) -> None:
    photo, path, rng = tmp_path / "7.png", tmp_path / "given.json", np.random.default_rng(4)
    whole = [json.dumps(content).encode() for content in (CAMERAS if kind == "cameras" else BOXES)]

    def read(number: int) -> None:
        path.write_bytes(damaged_json(whole[number % len(whole)], rng))
        if kind == "cameras":
            (camera,) = cameras_of(CameraOptions(cameras=path), [photo])
            assert np.isfinite(Intrinsics.of(camera, 640, 480).K).all()
        else:
            ((box, _),) = boxes_of(PlaceOptions(boxes=path), [photo], HintOptions())
            assert box is None or np.isfinite(box).all()

    counts = outcomes(range(COUNT), read)
    assert counts.total() == COUNT and counts["refused"] > COUNT // 5
