"""Damaged masks, cameras and boxes: a mask, a camera or a box of each photo, or one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from tests.fuzz.mutations import damaged, damaged_json, outcomes
from vig.photo import Intrinsics
from vig.photo.masks import read_mask
from vig_app.cli.boxes import boxes_of
from vig_app.cli.cameras import cameras_of
from vig_app.cli.common import FitCommand


def test_damaged_masks(tmp_path: Path) -> None:
    path, rng = tmp_path / "mask.png", np.random.default_rng(3)
    mask = np.zeros((40, 60), np.uint8)
    mask[10:30, 20:40] = 255
    Image.fromarray(np.dstack([mask] * 4)).save(path)
    whole = path.read_bytes()

    def read(_: int) -> None:
        path.write_bytes(damaged(whole, rng))
        found = read_mask(path)
        assert found.dtype == bool and found.ndim == 2

    counts = outcomes(range(200), read)
    assert counts.total() == 200 and counts["refused"] > 20


def test_damaged_cameras_and_boxes(tmp_path: Path) -> None:
    photo, path, rng = tmp_path / "7.png", tmp_path / "given.json", np.random.default_rng(4)
    cameras = json.dumps({"7": {"cam_K": [900, 0, 310, 0, 880, 250, 0, 0, 1]}, "8": [900, 880, 310, 250]})
    boxes = json.dumps({"7.png": [10, 20, 30, 40], "8.png": [{"box": [1, 2, 30, 40], "class": "mug"}]})

    def read(number: int) -> None:
        path.write_bytes(damaged_json((cameras if number % 2 else boxes).encode(), rng))
        if number % 2:
            (camera,) = cameras_of(FitCommand((photo,), cameras=path), [photo])
            assert np.isfinite(Intrinsics.of(camera, 640, 480).K).all()
        else:
            ((box, _),) = boxes_of(FitCommand((photo,), boxes=path), [photo])
            assert box is None or np.isfinite(box).all()

    counts = outcomes(range(300), read)
    assert counts.total() == 300 and counts["refused"] > 60
