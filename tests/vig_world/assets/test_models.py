"""The packaged models: sound meshes of real sizes, with authors, of one split each, that vary."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from vig.scene import Camera
from vig_world.assets.models import packaged_furniture, packaged_props, rows, vary, vary_furniture
from vig_world.assets.models.unwrapping import unwrap
from vig_world.assets.shapes import box
from vig_world.assets.things import ZONE_NAMES, Parts, is_of_class
from vig_world.dataset.spec import SPLITS, Split
from vig_world.mesh import Mesh
from vig_world.raster.rasterize import rasterize
from vig_world.rooms import kinds

ROOT = Path(__file__).parents[3]
LICENCES = {"Public domain", "CC-BY 3.0", "CC-BY 3.0 US"}


def read(split: Split) -> dict[str, Parts]:
    """Parts of every model of a split by name."""
    parts = {m.name: m.read() for models in packaged_props(split).values() for m in models}
    return parts | {m.name: m.read().parts for models in packaged_furniture(split).values() for m in models}


def extent(parts: Parts) -> tuple[np.ndarray, np.ndarray]:
    points = np.concatenate([mesh.vertices for mesh, _ in parts]).astype(float)
    return points.min(0), points.max(0)


def test_every_model_has_an_author_and_a_licence_and_one_split() -> None:
    names = [row.name for row in rows()]
    assert len(set(names)) == len(names)
    assert all(row.author and row.title and row.catalogue.endswith(".sh3f") for row in rows())
    assert {row.licence for row in rows()} <= LICENCES
    page = (ROOT / "docs/models.md").read_text(encoding="utf-8")
    assert all(f"| {row.author} | " in page and row.title in page for row in rows())
    table = (ROOT / "src/vig_world/assets/models/LICENSES.md").read_text(encoding="utf-8")
    assert table.partition("\n| ")[2] == page.partition("\n| ")[2], "the wheel has the same table"
    sizes = [(row.width, row.depth, row.height, row.faces) for row in rows()]
    assert len(set(sizes)) == len(sizes), "no model is there twice under two names"
    selection = tomllib.loads((ROOT / "tools/models.toml").read_text())
    stated = {
        (role, family, split, name)
        for role, families in selection.items()
        for family, settings in families.items()
        for split in SPLITS
        for name in settings.get(split, ())
    }
    assert {(row.role, row.family, row.split, row.name) for row in rows()} == stated


def test_there_are_enough_kinds() -> None:
    props = [row for row in rows() if row.role == "prop"]
    assert len({row.family for row in props}) >= 110
    counts = {split: sum(row.split == split for row in props) for split in SPLITS}
    assert counts["train"] >= 120 and min(counts.values()) >= 45
    for split in SPLITS:
        zones = {zone for models in packaged_props(split).values() for m in models for zone in m.zones}
        assert zones == set(ZONE_NAMES)
        for zone in ZONE_NAMES:
            assert sum(zone in models[0].zones for models in packaged_props(split).values()) >= 3


def test_every_split_has_the_furniture_that_rooms_ask_for() -> None:
    source = Path(kinds.__file__).read_text()
    families = [set(packaged_furniture(split)) for split in SPLITS]
    assert families[0] == families[1] == families[2]
    for family in families[0] - {"radiator", "pendant", "ceiling_lamp"}:
        assert family in source, "rooms ask for it"


@pytest.mark.parametrize("split", SPLITS)
def test_models_are_sound_and_of_the_stated_size(split: Split) -> None:
    stated = {row.name: row for row in rows()}
    for name, parts in read(split).items():
        low, high = extent(parts)
        row = stated[name]
        np.testing.assert_allclose(
            high - low, [float(row.width), float(row.depth), float(row.height)], atol=2e-3
        )
        assert abs(low[2]) < 1e-6 and np.abs(low[:2] + high[:2]).max() < 1e-3, "stands centred on the ground"
        largest = (high - low).max()
        assert (0.02 < largest < 0.65) if row.role == "prop" else (0.3 < largest < 2.6), name
        assert sum(len(mesh.faces) for mesh, _ in parts) == int(row.faces) <= 1300
        for mesh, material in parts:
            assert mesh.uv is not None and np.isfinite(mesh.vertices).all() and np.isfinite(mesh.uv).all()
            assert mesh.faces.min() == 0 and mesh.faces.max() == len(mesh.vertices) - 1
            assert 0 < material.texture.min() <= material.texture.max() <= 1
            assert row.role == "furniture" or not material.slot


@pytest.mark.parametrize("split", SPLITS)
def test_models_are_not_inside_out(split: Split) -> None:
    """From any side they cover nearly as much when faces that are turned away are left out, and as near."""
    camera = Camera(64, 64, 2.8 * 64, 32.0, 32.0, 6.0)
    for name, parts in read(split).items():
        low, high = extent(parts)
        starts = np.cumsum([0] + [len(mesh.vertices) for mesh, _ in parts])
        points = np.concatenate([mesh.vertices for mesh, _ in parts]) - (low + high) / 2
        points /= np.linalg.norm(points, axis=1).max()
        faces = np.concatenate([mesh.faces + s for (mesh, _), s in zip(parts, starts, strict=False)])
        agree = covered = 0
        for azimuth in np.arange(4) * np.pi / 2 + 0.4:
            matrix = camera.camera_from_world(azimuth, 0.5)
            view = points, faces, matrix[:3, :3], matrix[:3, 3], camera
            every, front = rasterize(*view).depth, rasterize(*view, cull=True).depth
            covered += np.isfinite(every).sum()
            agree += (np.isfinite(every) & (front < every + 0.03)).sum()
        assert agree > 0.85 * covered, name


@pytest.mark.parametrize("split", SPLITS)
def test_supports_lie_on_furniture_at_real_heights(split: Split) -> None:
    heights = {
        "dining_table": (0.65, 0.8), "desk": (0.6, 0.85), "coffee_table": (0.3, 0.6), "chair": (0.35, 0.55),
        "kitchen_counter": (0.7, 1.0), "bed": (0.3, 0.85), "sofa": (0.25, 0.95),
    }  # fmt: skip
    for family, models in packaged_furniture(split).items():
        for model in models:
            piece = model.read()
            low, high = extent(piece.parts)
            for support in piece.supports:
                reach = support.half if abs(np.cos(support.turn)) > 0.5 else support.half[::-1]
                assert (np.abs(support.centre[:2]) + reach <= high[:2] + 0.02).all()
                assert low[2] < support.centre[2] <= high[2] + 1e-3 and min(support.half) >= 0.07
                assert support.zone in ZONE_NAMES and support.clearance > 0.19
            if family in heights:
                least, most = heights[family]
                assert piece.supports or family in ("chair", "bed", "sofa"), model.name
                assert all(least <= support.centre[2] <= most for support in piece.supports[:1]), model.name


def test_variants_differ_in_proportions_and_colours_and_stand() -> None:
    model = packaged_props("train")["vase"][0]
    seeds = [vary(model.read(), np.random.default_rng(seed)) for seed in (1, 1, 2, 3, 4)]
    bounds = [extent(parts) for parts in seeds]
    np.testing.assert_array_equal(bounds[0][1], bounds[1][1])
    own = extent(model.read())[1]
    for low, high in bounds:
        assert low[2] == 0 and (np.abs(high / own - 1) < 0.27).all()
    shapes = {tuple((high / high[2]).round(4)) for _, high in bounds}
    colours = {tuple(parts[0][1].texture.mean((0, 1)).round(4)) for parts in seeds}
    assert len(shapes) == len(colours) == 4


def test_furniture_is_stretched_with_its_supports() -> None:
    piece = packaged_furniture("train")["dining_table"][0].read()
    varied = vary_furniture(piece, np.random.default_rng(3))
    factor = extent(varied.parts)[1] / extent(piece.parts)[1]
    assert (np.abs(factor - 1) < 0.051).all() and np.ptp(factor) > 1e-3
    before, after = piece.supports[0], varied.supports[0]
    assert after.centre[2] == pytest.approx(before.centre[2] * factor[2], rel=1e-4)
    assert {stuff.slot for _, stuff in varied.parts} == {stuff.slot for _, stuff in piece.parts}


def test_sharp_edges_are_split_and_lie_flat_in_metres() -> None:
    welded, index = np.unique(box((0.2, 0.3, 0.4)).vertices, axis=0, return_inverse=True)
    cube = unwrap(welded.astype(float), index.reshape(-1)[box((0.2, 0.3, 0.4)).faces])
    assert len(cube.vertices) == 24, "each side has its own corners"
    assert cube.uv is not None
    corners, flat = cube.vertices[cube.faces].astype(float), cube.uv[cube.faces].astype(float)
    for one, other in ((0, 1), (1, 2), (2, 0)):
        metres = np.linalg.norm(corners[:, one] - corners[:, other], axis=1)
        np.testing.assert_allclose(np.linalg.norm(flat[:, one] - flat[:, other], axis=1), metres, atol=1e-6)
    angle = 2 * np.pi * np.arange(16) / 16
    rings = [np.stack([np.cos(angle), np.sin(angle), np.full(16, z)], 1) for z in (0.0, 1.0)]
    k = np.arange(16)
    side = np.concatenate(
        [np.stack([k, (k + 1) % 16, k + 16], 1), np.stack([(k + 1) % 16, (k + 1) % 16 + 16, k + 16], 1)]
    )
    round_side: Mesh = unwrap(np.concatenate(rings), side)
    assert len(round_side.vertices) == 32, "a round wall stays smooth"


def test_a_thing_of_a_class_is_known_by_its_family_or_file() -> None:
    for family, name in (
        ("mug", "mug"), ("cup", "mug"), ("teapot", "teapot"), ("kettle", "teapot"), ("model_car", "car"),
        ("animal", "horse"), ("own/coffee-cups/cup-1.obj", "cup"), ("vase", "vases"),
    ):  # fmt: skip
        assert is_of_class(family, name), (family, name)
    for family, name in (
        ("vase", "mug"),
        ("creamer", "teapot"),
        ("own/tree.obj", "car"),
        ("coffee_press", "mug"),
    ):
        assert not is_of_class(family, name), (family, name)
