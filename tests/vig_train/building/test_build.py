import shutil
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import vig_train
from tests.vig_train.building.conftest import SETTINGS
from tests.vig_train.building.things import finned
from vig.io.errors import UserError
from vig.parallel import thread_limit
from vig.scene import ObjectClass, Symmetry
from vig.scene.object_class import BUILD_COMMAND
from vig_train.building import BuildResult, BuildSettings, build_class
from vig_train.building.build import STEPS as STEP_COUNT
from vig_train.building.build import check_folder, is_step
from vig_train.building.pictures import save_mesh_sheet
from vig_train.cli.classes import build
from vig_train.cli.common import command_line
from vig_train.cli.settings import Build
from vig_train.packs.transfer import KEPT_SHAPES, SHAPE_SAMPLES, Occlusion
from vig_world.assets.held_out import held_out_designs_of
from vig_world.assets.target import nearest_coefficients

STEPS = (
    "reading meshes of {meshes} ...",
    "drawing what was read, build/1-as-they-are.png ...",
    "sampling surfaces ...",
    "comparing poses ...",
    "looking for symmetries and the front ...",
    "making a template: the mesh most like the others, closed, of about 300 vertices ...",
    "carrying the template onto each mesh ...",
    "making the class: components, materials, holes through each mesh ...",
    "computing how light goes from part to part, on shapes of the class ...",
)
"""Lines with which a build's steps begin, in their order."""


def test_what_does_not_belong_is_refused_with_the_reason(built: tuple[BuildResult, Path]) -> None:
    result, _ = built
    assert len(result.splits) == 6
    assert set(result.refused) == {"ball.off", "notes.obj"}
    assert "far" in result.refused["ball.off"] or "template" in result.refused["ball.off"]
    assert "triangles" in result.refused["notes.obj"]


def test_the_last_line_counts_what_was_refused(
    built: tuple[BuildResult, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("vig_train.building.build_class", lambda *given: built[0])
    assert build(Build(Path("meshes"), built[1], recognizer=False)) == 0
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"6 of 8 meshes, 2 refused (see {built[1] / 'card.md'})" in last


def test_without_torch_a_class_has_no_network_and_says_what_gives_it_one(
    built: tuple[BuildResult, Path], tmp_path: Path, monkeypatch, capsys
) -> None:
    loaded = "vig_train.class_training", "vig_train.training"
    for name in [name for name in sys.modules if name.startswith(loaded)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(vig_train, "class_training", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr("vig_train.building.build_class", lambda *given: built[0])
    assert build(Build(Path("meshes"), tmp_path)) == 0
    last = capsys.readouterr().err.splitlines()[-1]
    assert "without a recognizer: pip install 'vig[train]', then vig class train" in last


def test_a_sheet_has_its_labels_and_an_arrow_to_the_front(tmp_path: Path) -> None:
    """A fin on +X is on the right, where the arrow's tip is."""
    mesh, sheets = finned(1.0, 1.5, 0.4), []
    drawn = [(np.asarray(mesh.vertices), np.asarray(mesh.faces))]
    for number, more in enumerate(({}, {"labels": ["7"]}, {"arrow": "the fin"})):
        save_mesh_sheet(tmp_path / f"{number}.png", drawn, above=True, **more)  # type: ignore[arg-type]
        sheets.append(np.asarray(Image.open(tmp_path / f"{number}.png")).astype(int))
    assert np.argwhere((sheets[1] != sheets[0]).any(2)).max() < 20
    rows, columns = np.nonzero((sheets[2] != sheets[0]).any(2))
    assert rows.min() > 280 and columns.max() > 145
    tip = (sheets[2] != sheets[0]).any(2)[:, 135:].sum(0)
    assert tip[tip > 0][-1] < tip.max(), "it narrows to the right"


def test_lying_and_tilted_meshes_stand_with_the_fin_to_the_front(built: tuple[BuildResult, Path]) -> None:
    result, pack = built
    model = ObjectClass.load(pack).shape_model
    assert result.upright.symmetries.symmetry == "none" and result.upright.symmetries.mirror
    designs = held_out_designs_of(ObjectClass.load(pack))
    assert designs is not None
    for vertices in (model.mean, *designs.vertices):
        assert vertices[:, 2].min() == pytest.approx(0, abs=2e-3)
        length, width, height = np.ptp(vertices, axis=0)
        assert min(height, length) > 1.3 * width  # 1.5 by 1.45 by 0.7
        fin = vertices[vertices[:, 0] > vertices[:, 0].min() + 0.8 * length]
        assert np.ptp(fin[:, 1]) < 0.3 * width


def test_the_pack_says_what_it_was_told_and_found(built: tuple[BuildResult, Path]) -> None:
    _, pack = built
    made = ObjectClass.load(pack)
    assert made.name == "finned" and made.front == "the fin" and made.symmetry is Symmetry.NONE
    assert np.ptp(made.shape_model.mean, axis=0).max() == pytest.approx(0.3, rel=0.02)
    assert made.transfer is not None and made.transfer.shape[1] == len(made.shape_model.mean)
    assert made.shape_model.mean[made.points["front"], 0] == made.shape_model.mean[:, 0].max()
    card = (pack / "card.md").read_text(encoding="utf-8")
    assert "ball.off" in card and "notes.obj" in card and "leave" not in card.split("## Meshes")[0]
    for named in ("1-as-they-are", "2-upright", "3-template", "4-registered", "5-refused", "6-components"):
        assert (pack / "build" / f"{named}.png").is_file()


def test_a_mesh_left_out_is_met_better_by_components_than_by_the_mean(
    built: tuple[BuildResult, Path],
) -> None:
    errors = built[0].components.errors
    assert min(errors) < 0.5 * errors[0] and min(errors) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["template", "how light goes"])
def test_a_build_that_was_interrupted_gives_the_same_pack(
    folder: Path, built: tuple[BuildResult, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    """What is half-built is no class yet, and says with which command it becomes one."""
    whole = built[1]
    pack = tmp_path / "pack"
    # What earlier stages kept is as if they had run here, so that the test is quick.
    shutil.copytree(whole / "build" / "kept", pack / "build" / "kept")
    next((pack / "build" / "kept").glob("holes-*")).unlink()

    parts = sorted((pack / "build" / "kept").glob("transfer-*"))
    assert len(parts) * KEPT_SHAPES == SHAPE_SAMPLES
    for kept in parts[:2]:
        kept.unlink()
    cast, interrupted = Occlusion.of, False

    def cast_or_stop(*given: Any) -> Occlusion:
        if interrupted and len(list(pack.rglob("transfer-*"))) == len(parts) - 1:
            raise KeyboardInterrupt  # in the middle of the stage
        return cast(*given)

    def interrupt(line: str) -> None:
        nonlocal interrupted
        interrupted = stage in line
        if interrupted and "light" not in stage:
            raise KeyboardInterrupt

    with thread_limit(1), monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(Occlusion, "of", cast_or_stop)
        build_class(folder, pack, SETTINGS, interrupt)
    with pytest.raises(UserError, match=f"unfinished. Run it again: vig class build {folder} --out {pack}"):
        ObjectClass.load(pack)
    build_class(folder, pack, SETTINGS, lambda line: None)
    files = [path for path in whole.rglob("*") if path.is_file() and "kept" not in path.parts]
    assert not (whole / BUILD_COMMAND).exists()
    assert len(files) >= 12
    for path in files:
        assert (pack / path.relative_to(whole)).read_bytes() == path.read_bytes(), path.name


@pytest.mark.slow
def test_one_mesh_makes_a_class_of_its_exact_shape(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    finned(1.0, 1.5, 0.45).export(tmp_path / "meshes" / "only.ply")
    settings = BuildSettings("only", up="z", vertices=300)
    made = build_class(tmp_path / "meshes", tmp_path / "pack", settings, lambda line: None)
    model = made.object_class.shape_model
    assert len(made.splits) == 1 and model.rigid
    loaded = ObjectClass.load(tmp_path / "pack")
    assert loaded.object_from_mesh is not None and loaded.transfer is not None
    assert not loaded.transfer[1:].any() and loaded.transfer[0].any()
    scan, _ = trimesh.sample.sample_surface(trimesh.load(tmp_path / "meshes" / "only.ply"), 500, seed=0)
    moved = scan @ loaded.object_from_mesh[:3, :3].T + loaded.object_from_mesh[:3, 3]
    surface = trimesh.Trimesh(loaded.shape_model.mean, loaded.shape_model.faces, process=False)
    points, _ = trimesh.sample.sample_surface(surface, 20_000, seed=0)
    nearest = np.linalg.norm(moved[:, None] - points[None], axis=2).min(1)
    assert np.median(nearest) < 0.01 * np.ptp(moved, axis=0).max(), "the file's own surface is the class's"
    weights = tmp_path / "pack" / "recognition.safetensors"
    weights.write_bytes(b"of the shapes so far")
    card = tmp_path / "pack" / "card.md"
    card.write_text(card.read_text() + "\n## Recognition\n\nhours of training\n")
    build_class(tmp_path / "meshes", tmp_path / "pack", settings, lambda line: None)
    assert weights.exists() and card.read_text().endswith("\n\n## Recognition\n\nhours of training\n")
    other = replace(settings, length=0.3)
    build_class(tmp_path / "meshes", tmp_path / "pack", other, lambda line: None)
    assert not weights.exists() and "hours" not in card.read_text(), "weights of other shapes explain nothing"
    assert (tmp_path / "pack" / "build" / "outdated" / weights.name).read_bytes() == b"of the shapes so far"


def test_round_things_stand_by_their_axis_and_become_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vig_train.building.pack.write_transfer", lambda *given: None)
    folder = tmp_path / "meshes"
    folder.mkdir()
    for number, (wide, tall) in enumerate(((0.5, 1.0), (0.45, 1.2), (0.55, 1.1))):
        profile = [[0, 0], [0.6 * wide, 0], [wide, 0.5 * tall], [0.3, 0.8 * tall], [0.35, tall], [0, tall]]
        mesh = trimesh.creation.revolve(profile)
        if number == 1:  # it lies, and has a handle
            handle = trimesh.creation.box((0.3, 0.06, 0.06))
            handle.apply_translation((wide + 0.1, 0, 0.5 * tall))
            mesh = trimesh.util.concatenate([mesh, handle])
            mesh.apply_transform(trimesh.transformations.rotation_matrix(1.5, (0.8, 0.6, 0)))
        mesh.export(folder / f"{number}.ply")
    settings = BuildSettings("bottle", up="z", symmetry="any-turn", vertices=500)
    made = build_class(folder, tmp_path / "pack", settings, lambda line: None)
    assert len(made.splits) == 3 and not made.object_class.families
    for shape in (made.components.mean, *(made.components.mean + 2 * made.components.basis)):
        radius, height = np.linalg.norm(shape[:, :2], axis=1), shape[:, 2]
        ring = np.abs(height - 0.5 * height.max()) < 0.04 * height.max()
        assert np.ptp(radius[ring]) < 0.15 * radius[ring].mean(), "the handle is no part of the shape"
    saved = ObjectClass.load(tmp_path / "pack")
    designs = held_out_designs_of(saved)
    assert designs is not None
    near = nearest_coefficients(saved.shape_model, designs.vertices).astype(np.float32)
    off = np.linalg.norm(saved.shape_model.vertices(near) - designs.vertices, axis=2)
    assert off.mean() < 0.02 * designs.vertices.max(), "vertices of designs are in the model's order"


@pytest.mark.parametrize(
    "told, expected",
    [
        ({"up": "w"}, "axis"),
        ({"front": "+q"}, "axis"),
        ({"length": 0.0}, "length"),
        ({"length": 1001.0}, "length"),
        ({"vertices": 3}, "vertices"),
        ({"symmetry": "quarter"}, "symmetry"),
        ({"places": {"moon": 1.0}}, "places"),
        ({"drops": (9,)}, "numbers of meshes"),
        ({"turns": {0: 90.0}}, "numbers of meshes"),
        ({"up": "z", "front": "z"}, "front"),
    ],
)
def test_wrong_settings_get_one_line(
    folder: Path, tmp_path: Path, told: dict[str, object], expected: str
) -> None:
    settings = BuildSettings("finned", **told)  # type: ignore[arg-type]
    with pytest.raises(UserError, match=expected):
        build_class(folder, tmp_path / "pack", settings, lambda line: None)
    assert not (tmp_path / "pack" / "class.json").exists()


def test_a_folder_of_broken_files_gets_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    folder.mkdir()
    triangle = "3 1 0\n{}\n0 1 0\n0 0 1\n3 0 1 2\n"
    (folder / "empty.off").write_bytes(b"")
    (folder / "text.obj").write_text("not a mesh\n")
    (folder / "nan.off").write_text("OFF\n" + triangle.format("nan 0 0"))
    (folder / "flat.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n")
    (folder / "point.off").write_text("OFF\n3 1 0\n1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n")
    (folder / "cloud.ply").write_bytes(trimesh.PointCloud(np.eye(3)).export(file_type="ply"))
    (folder / "huge.off").write_text("OFF\n9000000 9000000 0\n")
    (folder / "cut.glb").write_bytes(finned(1, 1, 1).export(file_type="glb")[:300])
    with pytest.raises(UserError) as caught:
        build_class(folder, tmp_path / "pack", BuildSettings("broken"), lambda line: None)
    assert "\n" not in str(caught.value) and "usable" in str(caught.value)
    assert not (tmp_path / "pack").exists()


def test_what_was_made_otherwise_is_not_overwritten(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "card.md").write_text("precious")
    (tmp_path / "file").write_text("precious")
    for out in (folder, tmp_path / "mine", tmp_path / "file"):
        with pytest.raises(UserError, match="did not make"):
            build_class(folder, out, SETTINGS)
    assert (tmp_path / "mine" / "card.md").read_text() == "precious"
    (tmp_path / "empty").mkdir()
    check_folder(tmp_path / "empty")


@pytest.mark.parametrize("told", [{"name": ""}, {"name": "a\nb"}, {"name": "x" * 101}, {"shows": "a\tb"}])
def test_a_text_that_no_class_can_have_is_told_at_once(told: dict[str, str]) -> None:
    with pytest.raises(UserError, match="1 to 100 printable characters"):
        replace(SETTINGS, **told).check()


def test_a_mesh_is_turned_once(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="two for one"):
        build(Build(folder, tmp_path / "pack", turn=("1:90", "1:180")))


def test_the_card_names_the_authors_of_a_catalogues_meshes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a build that says which step it is at, and how far it is."""
    monkeypatch.setattr("vig_train.building.pack.write_transfer", lambda *given: None)
    monkeypatch.setattr("vig_train.building.stages.genus", lambda *given: 0)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path, lines = tmp_path / "tiny.sh3f", ["license=CC-BY 3.0"]
    with zipfile.ZipFile(path, "w") as archive:
        for number, (name, creator) in enumerate((("Fin", "Ada | Bob"), ("Other fin", "")), 1):
            fields = {"name": name, "model": f"/{number}.obj", "creator": creator, "category": "Things"}
            fields |= {"width": "30", "depth": "20", "height": str(28 + 2 * number)}
            lines += [f"{key}#{number}={value}" for key, value in fields.items()]
            archive.writestr(
                f"{number}.obj", finned(1.0, 1.5, 0.4 + 0.1 * number).convex_hull.export(file_type="obj")
            )
        archive.writestr("PluginFurnitureCatalog.properties", "\n".join([*lines, "name#3=Lost"]))
    said: list[str] = []
    settings = BuildSettings("fin", up="z", vertices=300)
    made = build_class(f"{path}:fin", tmp_path / "pack", settings, said.append, progress=True)
    assert f"2 meshes from {path}:fin" in said
    steps = [line.format(meshes=f"{path}:fin") for line in STEPS]
    assert [line for line in said if is_step(line)] == steps and len(steps) == STEP_COUNT
    shown = capsys.readouterr().err
    for counted in ("2 of 2 files", "2 of 2 surfaces", "8 of 8 comparisons", "2 of 2 meshes"):
        assert counted in shown
    card = (tmp_path / "pack" / "card.md").read_text()
    assert "| fin/fin.obj | Fin | Ada / Bob | CC-BY 3.0 | tiny.sh3f |" in card
    assert "| other-fin/other-fin.obj | Other fin | unknown | CC-BY 3.0 | tiny.sh3f |" in card
    assert len(made.sources) == 2


def test_the_command_to_run_again_states_what_differs_from_the_defaults() -> None:
    given = {"front": "-z", "turn": ("7:90", "8:180"), "drop": (5,), "materials": False, "json": True}
    told = Build(Path("my meshes"), Path("car"), **given)
    expected = "vig class build 'my meshes' --out car --front=-z --turn 7:90 8:180 --drop 5 --no-materials"
    assert command_line("vig class build", told, ("meshes",), ("json",)) == expected


def test_the_command_numbers_its_stages_and_those_of_the_quick_recognizer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def built(meshes: Path, out: Path, settings: BuildSettings, say: Any, *rest: Any) -> None:
        for line in ("reading meshes ...", "2 meshes", "1/3 images: done in 4 s", "2/3 heads: training ..."):
            say(line)
        raise UserError("enough")

    monkeypatch.setattr("vig_train.building.build_class", built)
    with pytest.raises(UserError, match="enough"):
        build(Build(tmp_path, tmp_path / "pack"))
    assert capsys.readouterr().out.splitlines() == [
        "stage 1 of 12, 0 min so far: reading meshes ...",
        "2 meshes",
        "stage 2 of 12, 0 min so far: images: done in 4 s",
        "stage 3 of 12, 0 min so far: heads: training ...",
    ]
