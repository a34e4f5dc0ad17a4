"""Places of the object and of what hides it, as native code proposes them, beside plain references."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from vig.scene import ObjectClass
from vig_native import engine
from vig_world.assets.footprint import Footprint
from vig_world.assets.target import NO_DESIGN, standing_vertices
from vig_world.composition import occluders
from vig_world.composition.place import EDGE, EYE_CLEARANCE, LOWEST_EYE, NEAR_RAY, _Proposals
from vig_world.composition.stage import HAND_INSIDE, LAYOUT_SIZE, Actor, StagedRoom
from vig_world.dataset.spec import Lens, Room
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.rooms.layout import Layout
from vig_world.rotations import about_z

AZIMUTH, LEVEL = 0.7, 0.4
PLACE_GOOD, PLACE_TOO_SMALL = engine.PLACE_GOOD, engine.PLACE_TOO_SMALL
PLACE_EYE, PLACE_OPEN = engine.PLACE_EYE, engine.PLACE_OPEN


def actor_at(object_class: ObjectClass, elevation: float) -> Actor:
    vertices = standing_vertices(np.zeros(object_class.shape_model.modes), NO_DESIGN, object_class)
    view = View.through(Lens(), object_class, AZIMUTH, elevation, LAYOUT_SIZE)
    return Actor.of(view, object_class, vertices, elevation, AZIMUTH)


def is_free(layout: Layout, eye: np.ndarray) -> bool:
    """Whether an eye (3,) is inside the room and outside its furniture, both with some space."""
    start, end = layout.outline, np.roll(layout.outline, -1, axis=0)
    way, offset = end - start, eye[:2] - start
    t = np.clip((offset * way).sum(1) / (way**2).sum(1), 0, 1)[:, None]
    turned = np.arctan2(*(start - eye[:2]).T[::-1]), np.arctan2(*(end - eye[:2]).T[::-1])
    winding = ((turned[1] - turned[0] + np.pi) % (2 * np.pi) - np.pi).sum() / (2 * np.pi)
    return bool(
        LOWEST_EYE < eye[2] < layout.height - EYE_CLEARANCE
        and np.linalg.norm(offset - t * way, axis=1).min() > EYE_CLEARANCE
        and round(winding) == 1
        and not any(heights(solid, eye, EYE_CLEARANCE).max() <= 0 for solid in layout.solids)
    )


def heights(solid: np.ndarray, points: np.ndarray, margin: float) -> np.ndarray:
    """Of points (..., 3) over the six sides (..., 6) of a piece of furniture that is grown by a margin."""
    corners, (low, high) = solid[:4], solid[4]
    way = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([way[:, 1], -way[:, 0]], 1) / np.linalg.norm(way, axis=1, keepdims=True)
    sides = points[..., :2] @ normal.T - (normal * corners).sum(1)
    z = points[..., 2:]
    return np.concatenate([sides, low - z, z - high], axis=-1) - margin


def passes_furniture(layout: Layout, eye: np.ndarray, middle: np.ndarray) -> bool:
    """Whether the line from the eye to the object's middle leaves a piece of furniture before the object."""
    shares = np.linspace(-5, 1.5, 1301)
    for solid in layout.solids:
        inside = shares[heights(solid, eye + shares[:, None] * (middle - eye), NEAR_RAY).max(-1) < 0]
        if len(inside) and inside[0] < 0.9 and 0.1 < inside[-1] < 0.95:
            return True
    return False


@pytest.mark.parametrize("hiding", [False, True])
def test_states_of_places_are_those_of_a_plain_reference(
    library: Library, packaged: ObjectClass, hiding: bool
) -> None:
    found: Counter[int] = Counter()
    differing = 0
    for number in range(12):
        layout, rng = library.plan(number).layout, np.random.default_rng(number)
        actor = actor_at(packaged, float(rng.uniform(0.05, 0.7)))
        proposals = _Proposals(layout, actor, hiding, rng)
        states = proposals.states
        for place in range(0, len(states), 4):
            support, state = layout.supports[proposals.support[place]], int(states[place])
            origin, turn = proposals.pose(place, 0.0)
            to_layout = about_z(-turn)
            spot, eye = to_layout @ -np.array(origin), to_layout @ (actor.view.eye - origin)
            body = np.pad(actor.body.outline, ((0, 0), (0, 1))) @ to_layout.T + spot
            own = (body - support.centre) @ about_z(support.turn)
            room = np.array(support.half) - np.abs(own[:, :2]).max(0) - EDGE
            high = support.clearance - EDGE - actor.body.heights[1]
            middle = spot + [0.0, 0.0, actor.body.heights[1] / 2]
            crossed = eye[2] > spot[2] + support.clearance or passes_furniture(layout, eye, middle)
            expected = PLACE_OPEN if hiding and not crossed else PLACE_GOOD
            expected = expected if is_free(layout, eye) else PLACE_EYE
            expected = expected if min(*room, high) > -1e-9 else PLACE_TOO_SMALL
            found[expected] += 1
            differing += state != expected
    assert differing <= 0.005 * sum(found.values())  # lines that pass an edge between the reference's points
    assert min(found[each] for each in (PLACE_GOOD, PLACE_EYE, PLACE_TOO_SMALL)) >= 2
    assert (found[PLACE_OPEN] >= 5) == hiding


def test_a_slid_place_is_looked_at_anew(library: Library, packaged: ObjectClass) -> None:
    """Slid to the support's edge the object stands nearer to the camera's side, and so does the camera."""
    actor, checked = actor_at(packaged, 0.4), 0
    for number in range(8):
        layout = library.plan(number).layout
        proposals = _Proposals(layout, actor, False, np.random.default_rng(number))
        for place in proposals.sift(Counter()):
            origin, turn = proposals.pose(place, 0.9)
            eye = about_z(-turn) @ (actor.view.eye - origin)
            assert proposals.is_free(place, 0.9) == is_free(layout, eye)
            checked += 1
    assert checked > 10


@pytest.fixture(scope="module", params=[0.25, 0.8])
def stage(request: pytest.FixtureRequest, library: Library, packaged: ObjectClass) -> StagedRoom:
    """The object in the middle of the largest support of a room."""
    layout = library.plan(3).layout
    number = max(range(len(layout.supports)), key=lambda each: min(layout.supports[each].half))
    support = layout.supports[number]
    x, y, z = support.centre
    room = Room(3, number, support.zone, (-x, -y, -z), 0.0, ())
    return StagedRoom.empty(library, actor_at(packaged, request.param), room)


@pytest.mark.parametrize(
    "make", [occluders.standing, occluders.in_hand, occluders.reaching, occluders.branch, occluders.board]
)
def test_what_hides_the_object_is_before_it_and_above_the_support(
    stage: StagedRoom, make: occluders.Kind
) -> None:
    actor, view, rng, made = stage.actor, stage.actor.view, np.random.default_rng(5), 0
    for _ in range(60):
        candidate = make(stage, rng, LEVEL)
        if candidate is None:
            continue
        made += 1
        clouds = np.concatenate([stage.points(part) for part in candidate.parts])
        depths = clouds @ view.forward
        assert candidate.least < candidate.most
        assert candidate.front == pytest.approx(depths.min(), abs=1e-9)
        assert depths.min() > view.forward @ view.eye + stage.nearest - 1e-9
        ends = [clouds + offset * candidate.motion for offset in (candidate.least, candidate.most)]
        if candidate.stands:
            own = np.concatenate([stage.on_support(stage.support, end) for end in ends])
            assert (np.abs(own[:, :2]) <= np.array(stage.support.half) - stage.margin + 1e-9).all()
            assert (clouds @ actor.ahead).max() < -actor.front  # between the camera and the object
            assert candidate.bound >= LEVEL
        else:
            assert depths.max() < actor.body.depths[0] - stage.margin
            assert min(end[:, 2].min() for end in ends) >= stage.margin - 1e-9
        top, bottom, left, right = (int(edge[0]) for edge in view.windows(ends[0][None]))
        shown = np.isfinite(actor.depth)[top:bottom, left:right].sum() / len(actor.pixels)
        assert candidate.bound == pytest.approx(stage.hidden_share() + shown, abs=0.02)
        if candidate.parts[-1].role == "holder":
            for offset in (0.0, candidate.most):
                place = np.array(candidate.parts[-1].position) + offset * candidate.motion
                x, y, z = view.rotation @ place + view.translation
                pixel = view.camera.focal * np.array([x, y]) / z + [view.camera.cx, view.camera.cy]
                assert (np.abs(pixel - LAYOUT_SIZE / 2) <= LAYOUT_SIZE / 2 - HAND_INSIDE + 1e-6).all()
    assert made >= 10


def test_bounds_of_a_placed_prop_keep_off_the_object(stage: StagedRoom) -> None:
    rng = np.random.default_rng(8)
    candidates = [occluders.standing(stage, rng, LEVEL) for _ in range(20)]
    gaps = [
        float(Footprint.of(stage.points(each.parts[0]), stage.actor.view.forward).gap(stage.actor.body))
        for each in candidates
        if each is not None
    ]
    assert len(gaps) > 5 and np.median(gaps) >= stage.margin


def test_broad_sides_of_held_props_face_the_camera(stage: StagedRoom) -> None:
    """At a high level the axis of a prop's least extent is mostly within half a radian of the view."""
    rng, cosines = np.random.default_rng(6), []
    for _ in range(80):
        candidate: occluders.OccluderCandidate | None = occluders.in_hand(stage, rng, 1.0)
        if candidate is not None:
            part = candidate.parts[0]
            thin = int(stage.library.sizes(part.family, part.asset).argmin())
            cosines.append(abs(part.matrix()[:, thin] @ stage.actor.view.forward))
    assert len(cosines) > 20 and np.mean(np.array(cosines) > np.cos(0.6)) > 0.9


def test_a_draw_without_room_gives_nothing(
    library: Library, packaged: ObjectClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An arm's length nearer to the eye than anything may be."""
    stage = StagedRoom.empty(library, actor_at(packaged, 0.4), Room(3, 0, "desk", (0.0, 0.0, 0.0), 0.0, ()))
    monkeypatch.setattr(StagedRoom, "nearest", 1.0)
    kinds: list[Callable] = [occluders.in_hand, occluders.reaching, occluders.branch]
    assert all(kind(stage, np.random.default_rng(1), LEVEL) is None for kind in kinds)
