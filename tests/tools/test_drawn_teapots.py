"""Random designs: a function of the seed, sound, of every kind, each of its own."""

from collections import Counter

import numpy as np
import pytest

from tools.classes import drawn_teapots as drawn_module
from tools.classes.drawn_teapots import MIXING, draw_design, drawn_designs
from tools.classes.teapot_flaws import flaws
from vig_world.assets.designs.design import TEAPOTS, TeapotDesign
from vig_world.assets.designs.teapot import teapot_vertices


@pytest.fixture(scope="module")
def designs() -> tuple[TeapotDesign, ...]:
    return drawn_designs(24)


def test_a_pure_function_of_the_seed(designs: tuple[TeapotDesign, ...]) -> None:
    assert drawn_designs(3) == designs[:3]
    assert drawn_designs(3, seed=1) != designs[:3]
    assert draw_design(np.random.default_rng(5)) == draw_design(np.random.default_rng(5))


def test_they_are_sound_and_differ(designs: tuple[TeapotDesign, ...]) -> None:
    assert not any(flaws(design) for design in designs)
    named = TEAPOTS["train"] + TEAPOTS["test"] + TEAPOTS["validation"]
    shapes = np.stack([teapot_vertices(design) for design in (*named, *designs)])
    for number in range(len(named), len(shapes)):
        apart = np.linalg.norm(np.delete(shapes, number, axis=0) - shapes[number], axis=-1).mean(axis=1)
        assert apart.min() > 0.001


def test_handles_of_all_kinds_or_of_one(designs: tuple[TeapotDesign, ...]) -> None:
    kinds = Counter(design.handle for design in designs)
    assert kinds["behind"] > kinds["above"] > 0
    assert {design.handle for design in drawn_designs(4, ("above",))} == {"above"}


@pytest.mark.parametrize("design", TEAPOTS["train"][::12], ids=lambda design: design.name)
def test_ratios_are_undone(design: TeapotDesign) -> None:
    again = TeapotDesign(**MIXING.absolute(MIXING.relative(design)))
    np.testing.assert_allclose(teapot_vertices(again), teapot_vertices(design), atol=2e-5)


def test_giving_up_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawn_module, "flaws", lambda design: ["bad"])
    monkeypatch.setattr(drawn_module, "MAX_TRIES", 2)
    with pytest.raises(RuntimeError, match="2 drawn designs with a handle .* had flaws"):
        draw_design(np.random.default_rng(0))
