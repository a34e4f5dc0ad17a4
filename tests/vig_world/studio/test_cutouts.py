"""Cut-outs, of packaged props and of models in files: of one split each, none of the class's like."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world import SPLITS
from vig_world.assets.things import Material, Prop, is_of_class, prop
from vig_world.mesh import Mesh
from vig_world.studio import cutouts
from vig_world.studio.cutouts import model_cutouts, render_view
from vig_world.studio.studio import Studio, StudioSettings

BOX = """mtllib paint.mtl
usemtl red
v 0 0 0
v {x} 0 0
v {x} 1 0
v 0 1 0
v 0 0 1
v {x} 0 1
v {x} 1 1
v 0 1 1
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    (folder / "paint.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\n")
    for number in range(40):
        (folder / f"box-{number}.obj").write_text(BOX.format(x=1 + number / 10))
    (folder / "tea-cup.obj").write_text(BOX.format(x=1))
    (folder / "old-teapot.obj").write_text(BOX.format(x=1))
    return folder


def test_a_model_is_of_one_split_and_never_of_the_class(models: Path) -> None:
    files = [model_cutouts(str(models), split, "teapot").files for split in SPLITS]
    together = [name for names in files for name in names]
    assert len(together) == len(set(together)) == 41
    assert "old-teapot.obj" not in together and "tea-cup.obj" in together
    assert len(files[0]) > len(files[1]) and len(files[0]) > len(files[2])


def test_a_view_is_from_its_azimuth_and_as_large_at_any_distance() -> None:
    def wall(y: float, colour: list[float]) -> tuple[Mesh, Material]:
        corners = np.array([[-1, y, 0], [1, y, 0], [1, y, 2], [-1, y, 2]], np.float32)
        mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.zeros((4, 2), np.float32))
        return mesh, Material(np.array([[colour]], np.float32), "plastic", 0.5)

    shown = prop("walls", wall(-1.0, [1, 0, 0]), wall(1.0, [0, 0, 1]))

    def view(azimuth: float, distance: float) -> np.ndarray:
        return render_view(np.random.default_rng(0), shown, (azimuth, 0.1, 0.0), 64, distance).sum((0, 1))

    front, back = view(0.0, 8.0), view(np.pi, 8.0)
    assert front[0] > 10 * front[2] and back[2] > 10 * back[0], "fronts of catalogues look along -y"
    assert view(0.0, 80.0)[3] == pytest.approx(front[3], rel=0.3)


def test_cutouts_show_the_material_and_are_the_same_again(models: Path) -> None:
    def drawn() -> np.ndarray:
        return np.asarray(model_cutouts(str(models), "train", "teapot").draw(np.random.default_rng(3)))

    first = drawn()
    cutouts._cutouts.cache_clear()
    assert np.array_equal(first, drawn())
    covered = first[first[..., 3] > 200].astype(int)
    assert len(covered) > 500 and (covered[:, 0] > covered[:, 1] + 20).mean() > 0.8


def test_what_cannot_be_read_is_passed_over_until_nothing_is_left(tmp_path: Path) -> None:
    for number in range(12):
        (tmp_path / f"bad-{number}.obj").write_text("v 0 0 0\n")
    with pytest.raises(UserError, match="models that can be drawn"):
        model_cutouts(str(tmp_path), "train", "mug").draw(np.random.default_rng(0))


def test_a_folder_without_models_for_a_split_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "mug.obj").write_text(BOX.format(x=1))
    with pytest.raises(UserError, match="expected models for the train split; got none of 0"):
        model_cutouts(str(tmp_path), "train", "mug")


def test_the_studio_draws_them_before_objects(models: Path) -> None:
    teapot = ObjectClass.load("teapot")
    plain = Studio(teapot, StudioSettings(occluded=1.0, absent=0.0))
    with_models = Studio(teapot, StudioSettings(occluded=1.0, absent=0.0, props=str(models)))
    differ = sum(
        not np.array_equal(plain.draw(0, index).image, with_models.draw(0, index).image) for index in range(6)
    )
    assert differ >= 3
    image = with_models.draw(1, 0)
    assert np.array_equal(image.image, with_models.draw(1, 0).image)


def test_what_stands_in_an_objects_place_is_not_of_its_class() -> None:
    numbers = range(400)
    families = [cutouts._family_of(number) for number in numbers]
    assert {"animal", "model_car", "mug"} < set(families)
    for name, family in (("car", "model_car"), ("mug", "mug"), ("coffee mug", "cup")):
        assert is_of_class(family, name)
        drawn: list[int] = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(cutouts, "_numbered_cutout", lambda number, lookalike, to=drawn: to.append(number))
            for seed in range(100):
                cutouts.draw_cutout(np.random.default_rng(seed), "validation", name)
        assert not any(is_of_class(cutouts._family_of(number), name) for number in drawn)
        assert len(set(drawn)) > 80 and all(
            number // cutouts.CUTOUTS_PER_SPLIT == SPLITS.index("validation") for number in drawn
        )


def test_a_family_is_what_is_made() -> None:
    for number in range(12):
        seen: list[str] = []

        def note(rng: np.random.Generator, shown: Prop, roll: float, to: list[str] = seen) -> Image.Image:
            to.append(shown.family)
            return Image.new("RGBA", (1, 1))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(cutouts, "render_cutout", note)
            cutouts._make_cutout(number, False)
        assert seen == [cutouts._family_of(number)]
