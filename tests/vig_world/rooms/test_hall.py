import numpy as np
import pytest

from vig_world.library import HALL_SIZES, HALLS, Library
from vig_world.rooms.unfurnished import EMPTY, SPACE, draw_hall


@pytest.mark.parametrize("size", [1.0, 8.0])
def test_a_hall_has_space_on_all_sides_of_its_middle(size: float) -> None:
    for seed in range(8):
        hall = draw_hall(np.random.default_rng(seed), size)
        assert hall.kind == EMPTY and len(hall.solids) == 0
        assert min(np.abs(hall.outline).min(), hall.height) > SPACE * size
        (support,) = hall.supports
        assert (np.array(support.half) < hall.outline.max(0)).all()


def test_a_hall_is_closed() -> None:
    """Each edge of floor, walls and ceiling lies on the box, whose six sides they cover wholly."""
    hall = draw_hall(np.random.default_rng(0))
    x, y = (2 * hall.outline.max(0)).tolist()
    sides = {"floor": x * y, "ceiling": x * y, "wall": 2 * (x + y) * hall.height}
    areas = dict.fromkeys(sides, 0.0)
    for mesh, material in hall.parts:
        if material.slot in areas:
            a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
            areas[material.slot] += float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    assert areas == pytest.approx(sides)


def test_halls_follow_rooms_and_seamless_grounds_and_double() -> None:
    library = Library("validation")
    assert library.halls(0).start == library.sweeps.stop
    assert library.halls(1).start == library.halls(0).stop
    heights = [library.layout(library.halls(size).start).height for size in range(3)]
    np.testing.assert_allclose(heights, heights[0] * np.array([1.0, 2.0, 4.0]))
    every = library.halls(HALL_SIZES - 1).stop
    assert every == library.layouts + len(library.sweeps) + HALLS * HALL_SIZES
