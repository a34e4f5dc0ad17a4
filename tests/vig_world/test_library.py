from collections.abc import Iterator
from itertools import combinations

import numpy as np
import pytest

from tests.support import TEAPOT
from tools.classes.drawn_teapots import drawn_designs
from tools.classes.teapot import DRAWN_DESIGNS, teapot, teapot_families
from vig.scene import ObjectClass, rotate_z
from vig_world.assets.designs.design import TEAPOTS, TeapotDesign
from vig_world.assets.designs.teapot import teapot_vertices
from vig_world.assets.held_out import held_out_designs_of
from vig_world.assets.panoramas.light import local_light
from vig_world.assets.target import NO_DESIGN, draw_shape, nearest_shape, shape_vertices
from vig_world.dataset.spec import SPLITS, Split
from vig_world.library import HALL_SIZES, LAYOUTS, SLOTS, VARIANTS, Library
from vig_world.rooms.layout import material_under
from vig_world.streams import asset_rng


@pytest.fixture(scope="module")
def splits() -> tuple[Library, ...]:
    return tuple(Library(split) for split in SPLITS)


@pytest.fixture(scope="module")
def drawn_once() -> Iterator[None]:
    """Random designs of the builder are drawn once: a longer list begins with the shorter one."""
    drawn = drawn_designs(DRAWN_DESIGNS)

    def first(count: int, *handles: tuple[str, ...], **seed: int) -> tuple[TeapotDesign, ...]:
        return drawn_designs(count, *handles, **seed) if handles or seed else drawn[:count]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tools.classes.teapot.drawn_designs", first)
        yield


def disjoint(sets: list[set]) -> bool:
    return len(set.union(*sets)) == sum(len(each) for each in sets)


def test_the_splits_keep_their_numbers() -> None:
    """Every scene of a split depends on its place in the list; numbers of designs stand in datasets."""
    assert SPLITS == ("train", "test", "validation")
    drawn = [int(asset_rng(split, "layout", 0).integers(10**6)) for split in SPLITS]
    assert drawn == [334666, 41261, 325627]


def test_the_pack_holds_the_held_out_designs() -> None:
    held = held_out_designs_of(ObjectClass.load("teapot"))
    assert held is not None and held.splits == ("test",) * 10 + ("validation",) * 10 + ("train",) * 157
    named = teapot_vertices(TEAPOTS["test"][3])
    np.testing.assert_array_equal(held.vertices[held.names.index(TEAPOTS["test"][3].name)], named)
    # Those that scenes were made of when their vertices lay in the pack.
    mean = 1000 * np.abs(held.vertices).mean((0, 1), dtype=np.float64)
    np.testing.assert_allclose(mean, [58.928622, 26.867363, 93.211089], atol=1e-5)


@pytest.mark.slow
@pytest.mark.usefixtures("drawn_once")
def test_the_designs_of_the_pack_are_those_that_the_builder_draws() -> None:
    held, drawn = held_out_designs_of(ObjectClass.load("teapot")), teapot().scenes
    assert held is not None
    designs = [(design.name, split) for split, of_split in drawn.items() for design in of_split]
    assert list(zip(held.names, held.splits, strict=True)) == designs
    np.testing.assert_array_equal(held.vertices[-60:], [teapot_vertices(d) for d in drawn["train"][-60:]])


@pytest.mark.usefixtures("drawn_once")
def test_the_pack_holds_the_families(packaged: ObjectClass) -> None:
    built = teapot_families(packaged.shape_model)
    names = [family.name for family in packaged.families]
    assert names == ["handle behind", "handle above", "handle straight"]
    for held, made in zip(packaged.families, built, strict=True):
        assert held.share == made.share
        np.testing.assert_allclose(held.mean, made.mean, atol=2e-3)
        np.testing.assert_allclose(held.deviation, made.deviation, atol=2e-3)


def test_a_split_has_variants_of_each_of_its_own_models(splits: tuple[Library, ...]) -> None:
    """No two variants of a vase are alike; `test_models` says that no model belongs to two splits."""
    for library in splits:
        count = library.members("vase")
        assert count % VARIANTS[library.split] == 0
        sizes = {library.sizes("vase", number).tobytes() for number in range(count)}
        assert len(sizes) == count


def test_splits_share_no_layout_finish_or_panorama(splits: tuple[Library, ...]) -> None:
    outlines = [{lib.layout(n).outline.tobytes() for n in range(12)} for lib in splits]
    assert disjoint(outlines) and len(outlines[0]) == 12
    finishes = [{lib.finish("wood", n).tobytes() for n in range(12)} for lib in splits]
    assert disjoint(finishes)
    lights = [np.array([lib.light(n, 0.0, 0.3) for n in range(24)]) for lib in splits]
    for one, other in combinations(lights, 2):
        assert np.abs(one[:, None] - other[None]).max(-1).min() > 1e-3


def test_there_are_enough_rooms() -> None:
    assert LAYOUTS["train"] >= 80 and min(LAYOUTS["test"], LAYOUTS["validation"]) >= 24


@pytest.mark.parametrize(
    ("split", "designs"), [("test", TEAPOTS["test"]), ("validation", TEAPOTS["validation"])]
)
def test_shapes_beyond_training_are_of_the_splits_own_designs(
    split: Split, designs: tuple[TeapotDesign, ...]
) -> None:
    """Each deviates from the model as one of the split's designs does, and all of them occur."""
    teapot = ObjectClass.load(TEAPOT)
    rng = np.random.default_rng(0)
    held = np.stack([teapot_vertices(design) for design in TEAPOTS["test"] + TEAPOTS["validation"]])
    model = teapot.shape_model
    used = set()
    for _ in range(40):
        shape, design = draw_shape(rng, teapot, split)
        vertices = shape_vertices(shape, design, teapot)
        deviation = vertices - shape_vertices(shape, NO_DESIGN, teapot)
        assert 1e-4 < np.linalg.norm(deviation, axis=1).mean() < 3e-3
        # The deviation is the design's own: orthogonal to what the model can do.
        basis = model.basis.reshape(model.modes, -1).astype(float)
        flat = (held[design] - model.mean).ravel()
        residual = flat - basis.T @ np.linalg.lstsq(basis.T, flat, rcond=None)[0]
        np.testing.assert_allclose(deviation.ravel(), residual, atol=2e-3)
        used.add((TEAPOTS["test"] + TEAPOTS["validation"])[design])
    assert used == set(designs)
    assert draw_shape(rng, teapot, "train")[1] == NO_DESIGN, "it names no designs of training"
    assert len(TEAPOTS["train"]) == 97


def test_training_shapes_are_near_designs_that_the_model_was_made_from(packaged: ObjectClass) -> None:
    rng = np.random.default_rng(0)
    designs = held_out_designs_of(packaged)
    assert designs is not None
    for _ in range(20):
        shape, design = draw_shape(rng, packaged, "train")
        assert designs.splits[design] == "train" and np.abs(shape).max() <= 3
        model = packaged.shape_model.vertices(shape[None].astype(np.float32))[0]
        assert np.linalg.norm(shape_vertices(shape, design, packaged) - model, axis=1).mean() < 0.012


def test_shapes_beyond_training_scatter_by_half_a_deviation_about_their_design() -> None:
    teapot = ObjectClass.load(TEAPOT)
    rng = np.random.default_rng(3)
    drawn = [draw_shape(rng, teapot, "test") for _ in range(200)]
    off = np.stack([shape - nearest_shape(teapot, design)[0] for shape, design in drawn])
    inner = off[np.abs(np.stack([shape for shape, _ in drawn])) < 2.9]  # the others are clipped
    assert inner.std() == pytest.approx(0.5, abs=0.03) and abs(inner.mean()) < 0.05


def test_light_turns_with_its_panorama(splits: tuple[Library, ...]) -> None:
    for library, angle in zip(splits, (0.4, 2.9, -1.7), strict=True):
        still = library.light(3, 0.0, 0.3)
        np.testing.assert_allclose(library.light(3, angle, 0.3), rotate_z(still, angle), atol=1e-14)


def test_a_brighter_support_sends_more_light_up(splits: tuple[Library, ...]) -> None:
    """Y10 grows with height, so light from below lowers its coefficient at the same exposure."""
    radiance = splits[0].radiance(0)
    dark, bright = local_light(radiance, 0.05), local_light(radiance, 0.8)
    assert bright[2] < dark[2]


def test_every_slot_has_finishes(splits: tuple[Library, ...]) -> None:
    rng = np.random.default_rng(1)
    for slot in SLOTS:
        finish = splits[0].draw_finish(slot, rng)
        assert splits[0].finish(finish.kind, finish.asset).shape == (128, 128, 3)
        assert 0 < splits[0].albedo(finish.kind, finish.asset) < 0.9


def test_light_from_below_is_that_of_the_support(splits: tuple[Library, ...]) -> None:
    """The material found under a support is what a ray from above meets; most have a slot's finish."""
    library, found, missing = splits[0], [], 0
    for number in range(6):
        layout = library.layout(number)
        for index, support in enumerate(layout.supports):
            material = material_under(layout, support)
            missing += material is None
            slot, _ = library.plan(number).grounds[index]
            found.append(slot)
            if support.zone == "floor":
                assert slot == "floor"
    assert missing <= 0.05 * len(found)
    assert {"top", "wood", "fabric", "floor"} <= set(found)


@pytest.mark.parametrize("split", SPLITS)
def test_a_split_s_rooms_and_panoramas_are_made_once(split: Split) -> None:
    """In random order a cache smaller than the catalogue would make most of them again and again."""
    library = Library(split)
    rooms = library.halls(HALL_SIZES - 1).stop
    for cached, count in (
        (library.layout, rooms),
        (library.plan, rooms),
        (library.radiance, library.panoramas),
    ):
        assert count <= cached.cache_parameters()["maxsize"]


def test_the_numbers_after_a_family_s_members_are_the_same_ones_smaller() -> None:
    library = Library("validation")
    for family in ("vase", "arm"):
        count = library.members(family)
        for halvings in (1, 3):
            smaller = library.extremes(family, 2 + halvings * count)
            np.testing.assert_allclose(smaller, 0.5**halvings * library.extremes(family, 2), atol=1e-6)
