"""Videos of a turning object: it turns, all else stays, and what hides it passes."""

import numpy as np
import pytest

from benchmarks import turning
from benchmarks.turning import HIDDEN, OPEN, Turning, draw_turning, turn_scene
from vig.io.errors import UserError
from vig.scene import ObjectClass
from vig_world.composition.sampling import CompositionError, sample
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.renderers.rasterized import render


@pytest.fixture(scope="module")
def library() -> Library:
    return Library("validation")


@pytest.fixture(scope="module")
def video(library: Library, packaged: ObjectClass) -> Turning:
    return draw_turning(library, packaged, 3, 4)


def test_what_hides_the_object_passes_and_its_angle_goes_round(
    library: Library, packaged: ObjectClass, video: Turning
) -> None:
    scenes = list(video.frames(9))
    hidden = [render(library, scene, packaged).occlusion for scene in scenes]
    assert hidden[4] == pytest.approx(video.scene.occlusion, abs=0.05) and hidden[4] > HIDDEN[0] - 0.05
    assert hidden[0] <= OPEN + 0.05 and hidden[-1] <= OPEN + 0.1
    steps = np.diff(np.unwrap([scene.azimuth for scene in scenes]))
    assert np.sum(steps) == pytest.approx(-video.turn, abs=1e-6)
    assert (np.sign(steps) == -np.sign(video.turn)).all()


def test_only_the_object_turns(library: Library, packaged: ObjectClass, video: Turning) -> None:
    """Told in the object's frame everything else turns, so that the picture beside the object is the same."""
    one = render(library, video.scene, packaged)
    other = render(library, turn_scene(video.scene, 1.0), packaged)
    beside = ~(one.amodal | other.amodal)
    off = np.abs(one.image.astype(int) - other.image.astype(int))[beside]
    assert beside.sum() > 3000 and np.mean(off) < 1.5 and np.median(off) == 0
    both = one.visible & other.visible
    assert np.abs(one.image.astype(int) - other.image.astype(int))[both].mean() > 3
    whole = render(library, turn_scene(video.scene, 2 * np.pi), packaged)
    assert np.abs(one.image.astype(int) - whole.image.astype(int)).mean() < 0.5


def test_a_video_follows_from_its_seed(library: Library, packaged: ObjectClass, video: Turning) -> None:
    assert draw_turning(library, packaged, 3, 4) == video
    assert draw_turning(library, packaged, 3, 1) != video


def test_a_scene_that_cannot_be_composed_is_passed_over(
    library: Library, packaged: ObjectClass, video: Turning, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next that is fit for a video takes its place; without any there is one line."""

    def failing(library: Library, object_class: ObjectClass, seed: int, number: int) -> SceneSpec:
        if number <= video.scene.index or number >= 410:
            raise CompositionError("no room")
        return sample(library, object_class, seed, number)

    monkeypatch.setattr(turning, "sample", failing)
    assert video.scene.index < draw_turning(library, packaged, 3, 4).scene.index < 410
    with pytest.raises(UserError, match="video 3 of seed 3: .* none of 100 scenes"):
        draw_turning(library, packaged, 3, 3)
