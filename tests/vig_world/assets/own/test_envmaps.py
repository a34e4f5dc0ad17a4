"""Users' panoramas: energy kept, order fixed, bad files named and left out."""

import hashlib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from vig.io.errors import UserError
from vig_world.assets.own.envmaps import read_envmaps, resized
from vig_world.assets.panoramas.light import project_panorama


def save(path: Path, radiance: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width, channels = radiance.shape
    target = oiio.ImageOutput.create(str(path))
    target.open(str(path), oiio.ImageSpec(width, height, channels, oiio.FLOAT))
    target.write_image(radiance.astype(np.float32))
    target.close()
    return path


def room(height: int = 32, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 3.0, (height, 2 * height, 3))


def solid_angles(height: int) -> np.ndarray:
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    return (edges[:-1] - edges[1:])[:, None, None] * np.pi / height


@pytest.mark.parametrize("height", [16, 40, 64, 100, 256])
def test_resizing_keeps_the_energy_of_each_channel(height: int) -> None:
    image = room(96)
    image[40, 7] = 1e4  # a lamp in one pixel
    small = resized(image, height)
    assert small.shape == (height, 2 * height, 3)
    total = (image * solid_angles(96)).sum((0, 1))
    np.testing.assert_allclose((small * solid_angles(height)).sum((0, 1)), total, rtol=1e-5)


def test_resizing_keeps_what_is_where() -> None:
    image = np.zeros((128, 256, 3))
    image[20:30, 200:210, 0] = 5.0
    light, small = project_panorama(image), project_panorama(resized(image, 64))
    assert np.abs(light - small).max() < 0.02 * light[0, 0]


def test_panoramas_come_in_the_order_of_their_names_with_their_files_hash(tmp_path: Path) -> None:
    second = save(tmp_path / "b.exr", room(seed=1))
    first = save(tmp_path / "a" / "z.HDR", room(seed=2))
    panoramas, problems = read_envmaps(tmp_path)
    assert [panorama.name for panorama in panoramas] == ["a/z.HDR", "b.exr"] and problems == []
    assert panoramas[0].radiance.shape == (64, 128, 3)
    assert panoramas[0].sharp().shape == (32, 64, 3)  # never larger than the file
    line = f"b.exr\0{hashlib.sha256(second.read_bytes()).hexdigest()}\n"
    assert panoramas[1].fingerprint == hashlib.sha256(line.encode()).hexdigest()
    save(first, room(seed=3))
    assert read_envmaps(tmp_path)[0][0].fingerprint != panoramas[0].fingerprint


def test_sharp_panoramas_have_at_most_256_rows(tmp_path: Path) -> None:
    save(tmp_path / "a.exr", room(300))
    assert read_envmaps(tmp_path)[0][0].sharp().shape == (256, 512, 3)


def test_bad_files_are_named_and_left_out(tmp_path: Path) -> None:
    save(tmp_path / "good.exr", room())
    for name, value in (("nan", np.nan), ("inf", np.inf), ("negative", -1.0)):
        image = room()
        image[3, 4, 1] = value
        save(tmp_path / f"{name}.exr", image)
    save(tmp_path / "square.exr", np.ones((32, 32, 3)))
    save(tmp_path / "black.exr", np.zeros((32, 64, 3)))
    (tmp_path / "text.hdr").write_text("not a panorama")
    (tmp_path / "empty.hdr").touch()
    dark_above = room()
    dark_above[:16] = 0
    save(tmp_path / "below.exr", dark_above)
    (tmp_path / "notes.txt").write_text("is no panorama and is not mentioned")
    panoramas, problems = read_envmaps(tmp_path)
    assert [panorama.name for panorama in panoramas] == ["good.exr"]
    assert len(problems) == 8
    for name in ("nan", "inf", "negative", "square", "black", "below"):
        (line,) = [problem for problem in problems if f"{name}.exr" in problem]
        assert "expected" in line and line.endswith("Left out.") and "\n" not in line


def test_what_resampling_leaves_below_zero_is_taken_for_zero(tmp_path: Path) -> None:
    image = room()
    image[20, 5] = -0.01 * image.mean()
    save(tmp_path / "a.exr", image)
    ((panorama,), problems) = read_envmaps(tmp_path)
    assert problems == [] and panorama.sharp().min() == 0


def test_a_folder_without_a_usable_panorama_is_the_users_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nothing of that name"):
        read_envmaps(tmp_path / "no")
    with pytest.raises(UserError, match="expected files .hdr .exr; got none"):
        read_envmaps(tmp_path)
    save(tmp_path / "black.exr", np.zeros((32, 64, 3)))
    with pytest.raises(UserError, match="not one usable panorama.*black.exr"):
        read_envmaps(tmp_path)
