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
from vig_world.studio.cutouts import ModelCutouts
from vig_world.studio.layers import Layer, place_of


def noise(count: int) -> Examples:
    """Images of nothing, with some truth."""
    rng = np.random.default_rng(count)
    pixels = torch.from_numpy(rng.integers(0, 256, (count, 150, 150, 5), dtype=np.uint8))
    angles, numbers = torch.rand(2, count), torch.rand(count, trunk.LAYOUT.size)
    seen = pixels[..., 3] // 2 + 127
    return Examples(pixels[..., :3], angles[0], numbers, angles[1], seen, 255 - seen)


def test_a_things_front_is_towards_the_camera_at_90_degrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "paint.mtl").write_text("newmtl front\nKd 1 0 0\nnewmtl rest\nKd 0 0 1\n")
    places = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    # The front is at y = 0, as that of unpacked catalogues, which look along -y.
    sides = "usemtl front\nf 1 5 6 2\nusemtl rest\nf 2 6 8 4\nf 1 3 7 5\nf 1 2 4 3\nf 5 7 8 6\nf 3 4 8 7\n"
    (tmp_path / "vig.toml").write_text("[defaults]\nup = 'z'\n")
    for number in range(20):  # so that each split has some
        (tmp_path / f"box{number}.obj").write_text(f"mtllib paint.mtl\n{places}{sides}")
    clear = Layer(np.zeros((150, 150, 3), np.float32), np.zeros((150, 150), np.float32))
    monkeypatch.setattr(trunk, "draw_ground", lambda *arguments: clear.colour)
    monkeypatch.setattr(trunk, "draw_thing", lambda *arguments: clear)
    monkeypatch.setattr(trunk, "occlude", lambda rng, picture, cover, *others: (picture, 0.5 * cover))
    monkeypatch.setattr(trunk, "photograph", lambda rng, picture: (255 * picture.clip(0, 1)).astype(np.uint8))
    monkeypatch.setattr(trunk, "CLASSES", ())
    monkeypatch.setattr(trunk, "CLASS_SHARE", 0.0)
    monkeypatch.setattr(trunk, "PROP_SHARE", 0.0)
    many = trunk.ManyKinds(str(tmp_path), "train", 0)
    drawn = [many.draw(index) for index in range(40)]
    again = many.draw(7)
    assert all(np.array_equal(again[name], value) for name, value in drawn[7].items())
    towards, red, sides = [], [], []
    for each in drawn:
        sides.append(place_of((each["visible"].astype(float) + each["hidden"]) / 255)[2])
        assert (each["visible"].astype(int) + each["hidden"] <= 255).all() and each["visible"].any()
        if each["numbers"][trunk.LAYOUT.at("elevation")] < 0.7:
            shares = each["images"].reshape(-1, 3).astype(float).sum(0)
            towards.append(np.cos(each["azimuth"] - np.pi / 2))
            red.append(shares[0] / (shares[0] + shares[2]))
    assert 0.6 < np.median(sides) < 0.8, "framed as by boxes"
    towards, red = np.array(towards), np.array(red)
    assert (towards > 0.5).sum() > 3 and red[towards > 0.5].min() > 0.15
    assert (towards < -0.5).sum() > 3 and red[towards < -0.5].max() < 0.1


def test_the_trunk_has_the_arrays_of_the_packaged_one_and_its_first_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = {"train": noise(16), "validation": noise(8)}
    monkeypatch.setattr(trunk, "draw", lambda *arguments: drawn)
    monkeypatch.setattr(trunk, "model_cutouts", lambda *arguments: ModelCutouts(tmp_path, ()))
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
