"""The tool that trains the trunk: the file that it writes."""

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from tools.classes import trunk
from vig.recognition.weights import TRUNK_FILE
from vig.scene import ObjectClass
from vig_train.training.examples import Examples


def noise(count: int) -> Examples:
    """Images of nothing, with some truth."""
    rng = np.random.default_rng(count)
    pixels = torch.from_numpy(rng.integers(0, 256, (count, 150, 150, 5), dtype=np.uint8))
    angles, numbers = torch.rand(2, count), torch.rand(count, trunk.LAYOUT.size)
    seen = pixels[..., 3] // 2 + 127
    return Examples(pixels[..., :3], angles[0], numbers, angles[1], seen, 255 - seen)


def test_the_trunk_has_the_arrays_of_the_packaged_one_and_its_first_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = {"train": noise(16), "validation": noise(8)}
    monkeypatch.setattr(trunk, "draw", lambda *arguments: drawn)
    start = ObjectClass.load("car").folder
    assert start is not None
    words = ["--meshes", "none", "--epochs", "1", "--batch", "8", "--workers", "1", "--start"]
    trunk.main([str(tmp_path), *words, str(start / "recognition.safetensors")])
    before, after = load_file(TRUNK_FILE), load_file(tmp_path / "trunk.safetensors")
    shapes = [{name: (each.shape, each.dtype) for name, each in file.items()} for file in (before, after)]
    assert shapes[0] == shapes[1]
    changed = {name for name in before if not np.array_equal(before[name], after[name])}
    assert any(name.startswith("stages.4") for name in changed)
    assert not any(name.startswith(("stem", "stages.0")) for name in changed), "the first stage is frozen"
