"""Scenes of things long, flat, tall, tiny and huge: none is drawn anew, and latents keep distributions."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from tests.toys import toy
from vig.scene import ObjectClass
from vig_world.assets.target import NO_DESIGN, shape_vertices, standing_vertices, target_vertices
from vig_world.composition.photographs import LEVEL, LEVEL_SHARE, LOW, LOW_SHARE, draw_manner
from vig_world.composition.place import find_place, fits_seamless_ground
from vig_world.composition.sampling import MANNER_STREAM, TOLERANCE, sample, target_occlusion
from vig_world.composition.stage import LAYOUT_SIZE, Actor
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.renderers.rasterized import render
from vig_world.rooms.unfurnished import EMPTY
from vig_world.streams import stream

SIZES = {
    "long": (0.3, 0.03, 0.02),
    "flat": (0.3, 0.25, 0.035),
    "tall": (0.1, 0.1, 0.4),
    "tiny": (0.02, 0.015, 0.015),
    "huge": (2.0, 0.9, 0.8),
}
"""Metres along x, y and z."""
SEED, COUNT = 0, 20


def stretched(name: str) -> ObjectClass:
    """A box with a fin of the size of the mean shape, with shapes up to three deviations off it."""
    fin, size = toy("fin"), np.array(SIZES[name], np.float32)
    factor = size / np.ptp(fin.shape_model.mean, axis=0)
    model = replace(fin.shape_model, mean=fin.shape_model.mean * factor, basis=fin.shape_model.basis * factor)
    places = {"floor": 1.0} if name == "huge" else {}
    return replace(
        fin,
        shape_model=model,
        target_height=float(size[2] / 2),
        viewing_distance=float(1.5 * size.max()),
        places=places,
    )


@pytest.fixture(scope="module")
def specs(library: Library) -> dict[str, list[SceneSpec]]:
    return {name: [sample(library, stretched(name), SEED, index) for index in range(COUNT)] for name in SIZES}


def in_hall(library: Library, spec: SceneSpec) -> bool:
    return library.plan(spec.room.layout).layout.kind == EMPTY


def test_latents_are_those_that_were_drawn_and_as_much_is_hidden_as_was_asked(
    specs: dict[str, list[SceneSpec]],
) -> None:
    """Whatever the room: each scene is the first of its sample, with its own lens and its own share."""
    for name, scenes in specs.items():
        object_class = stretched(name)
        for index, spec in enumerate(scenes):
            rng = stream(SEED, index, "validation", MANNER_STREAM)
            drawn = draw_manner(rng, object_class, target_vertices(spec, object_class), spec.azimuth)
            assert (spec.elevation, spec.lens) == (drawn.elevation, drawn.lens)
            assert spec.target == target_occlusion(SEED, index, "validation")
            assert abs(spec.occlusion - spec.target) <= TOLERANCE
            assert "scene" not in spec.rejected


def test_distributions_of_what_is_kept_are_the_documented_ones(specs: dict[str, list[SceneSpec]]) -> None:
    kept = [spec for scenes in specs.values() for spec in scenes]
    assert kstest([spec.azimuth for spec in kept], "uniform", (0, 2 * np.pi)).pvalue > 0.01
    assert kstest([spec.occlusion for spec in specs["flat"]], "uniform", (0, 0.9)).pvalue > 0.01

    def below(elevation: np.ndarray) -> np.ndarray:
        bounds = [0.0, LEVEL, LOW, 0.49 * np.pi]
        return np.interp(elevation, bounds, [0.0, LEVEL_SHARE, LEVEL_SHARE + LOW_SHARE, 1.0])

    assert kstest([spec.elevation for spec in specs["flat"]], below).pvalue > 0.01


def test_what_no_room_has_space_for_stands_in_a_hall_that_holds_its_camera(
    library: Library, specs: dict[str, list[SceneSpec]]
) -> None:
    """The eye is not in the ground, beyond a wall or above the ceiling; a surface is behind all pixels."""
    halls = {name: [spec for spec in scenes if in_hall(library, spec)] for name, scenes in specs.items()}
    assert all(halls[name] for name in ("long", "flat", "huge"))
    assert sum(map(len, halls.values())) < 0.2 * COUNT * len(SIZES), "rooms stay the rule"
    for name, scenes in halls.items():
        for spec in scenes:
            layout = library.plan(spec.room.layout).layout
            view = View.of_scene(spec, stretched(name))
            eye = (view.eye - np.array(spec.room.origin)) @ spec.room.rotation()
            assert 0 < eye[2] < layout.height
            assert (np.abs(eye[:2]) < layout.outline.max(0)).all()
            picture = render(library, spec, stretched(name))
            assert np.isfinite(picture.depth).all()
            assert abs(picture.occlusion - spec.target) <= 2 * TOLERANCE


def test_the_whole_of_a_tiny_thing_is_drawn(library: Library, specs: dict[str, list[SceneSpec]]) -> None:
    """Its camera is 27 mm away, nearer than which other things are clipped at 20 mm."""
    tiny = stretched("tiny")
    for spec in specs["tiny"][:6]:
        view = View.of_scene(spec, tiny)
        seen = target_vertices(spec, tiny) @ view.rotation.T + view.translation
        assert seen[:, 2].min() > view.near
        assert all(prop_depth(library, spec, view, number) > view.near for number in range(len(spec.props)))
        assert abs(render(library, spec, tiny).occlusion - spec.target) <= 3 * TOLERANCE


def prop_depth(library: Library, spec: SceneSpec, view: View, number: int) -> float:
    """Least depth of a prop in the frame's cone, metres; of one behind the camera inf."""
    prop = spec.props[number]
    points = library.extremes(prop.family, prop.asset) @ prop.matrix().T + prop.position
    depths = points @ view.rotation[2] + view.translation[2]
    return float(depths.min()) if prop.role == "occluder" else np.inf


def test_a_view_said_to_fit_no_seamless_ground_finds_no_place_on_any(library: Library) -> None:
    fitting = []
    for name in ("flat", "huge"):
        object_class = stretched(name)
        vertices = object_class.shape_model.mean
        for number in range(30):
            rng = np.random.default_rng(number)
            azimuth = rng.uniform(0, 2 * np.pi)
            manner = draw_manner(rng, object_class, vertices, azimuth)
            view = View.through(manner.lens, object_class, azimuth, manner.elevation, LAYOUT_SIZE)
            actor = Actor.of(view, object_class, vertices, manner.elevation, azimuth)
            fitting.append(fits_seamless_ground(actor))
            places = [
                find_place(
                    library, library.sweeps, actor, (), (0.0, 1.0), np.random.default_rng(seed), Counter()
                )
                for seed in range(4)
            ]
            assert fitting[-1] or places == [None] * 4
    assert 0.1 < np.mean(fitting) < 0.9


def test_a_shape_of_the_model_stands_on_the_ground_too() -> None:
    """Tilted by a component, a bar's lowest vertex would be 1.4 cm in the ground."""
    bar = stretched("long")
    basis = np.zeros_like(bar.shape_model.basis)
    basis[0, :, 2] = 0.1 * bar.shape_model.mean[:, 0]
    tilted = replace(bar, shape_model=replace(bar.shape_model, basis=basis))
    shape = np.array([1.5, 0.0, 0.0])
    low, standing = (make(shape, NO_DESIGN, tilted) for make in (shape_vertices, standing_vertices))
    assert low[:, 2].min() < -0.01 and standing[:, 2].min() == 0
    np.testing.assert_allclose(np.ptp(standing - low, axis=0), 0, atol=1e-6)
