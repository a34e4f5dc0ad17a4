import io
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vig.io.errors import UserError
from vig.scene import EXPOSURE_L00, ObjectClass, rotate_z
from vig_world.assets.panoramas.light import project_panorama
from vig_world.composition.sampling import sample
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.renderers.cycles import CyclesRenderer, renderer
from vig_world.renderers.cycles.blender import wire
from vig_world.renderers.cycles.message import compose
from vig_world.renderers.cycles.process import BlenderProcess, WorkerDiedError
from vig_world.renderers.cycles.renderer import PYTHON_VARIABLE, arriving, find_python
from vig_world.renderers.rasterized import render

WIRE = Path(wire.__file__).parent
FAKE = f"""
import os, sys, time
sys.path.insert(0, {str(WIRE)!r})
import numpy as np, wire
requests, replies = sys.stdin.buffer, sys.stdout.buffer
wire.send(replies, {{"blender": "fake"}}, {{}})
while True:
    try:
        header, arrays = wire.receive(requests)
    except EOFError:
        break
    if header.get("do") == "die":
        print("out of memory", file=sys.stderr, flush=True)
        os._exit(3)
    if header.get("do") == "sleep":
        time.sleep(60)
    wire.send(replies, {{"pid": os.getpid()}}, {{"double": 2 * arrays["x"]}})
"""
"""A worker without Blender: doubles x, dies or sleeps as told."""


@pytest.fixture(scope="module")
def library() -> Library:
    return Library("train")


@pytest.fixture(scope="module")
def spec(library: Library, teapot: ObjectClass) -> SceneSpec:
    return sample(library, teapot, 5, 8, "paper")


def test_messages_come_out_as_they_went_in() -> None:
    arrays = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "none": np.zeros((0, 3), np.int32)}
    stream = io.BytesIO()
    wire.send(stream, {"n": 1, "s": "é"}, arrays)
    wire.send(stream, {}, {"b": np.array(2.5)[None]})
    stream.seek(0)
    header, back = wire.receive(stream)
    assert header == {"n": 1, "s": "é"}
    assert all(np.array_equal(back[k], v) and back[k].dtype == v.dtype for k, v in arrays.items())
    assert wire.receive(stream)[1]["b"] == 2.5
    with pytest.raises(EOFError):
        wire.receive(stream)


def test_a_worker_answers_until_it_dies_and_tells_its_last_words() -> None:
    worker = BlenderProcess([sys.executable, "-c", FAKE])
    assert worker.hello == {"blender": "fake"}
    big = np.arange(500_000, dtype=np.float64)  # more than a pipe holds
    np.testing.assert_array_equal(worker.ask({}, {"x": big}, 20)[1]["double"], 2 * big)
    with pytest.raises(WorkerDiedError, match="ended with code 3; last line of its log: out of memory"):
        worker.ask({"do": "die"}, {}, 20)


def test_a_worker_that_takes_too_long_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vig_world.renderers.cycles.process.GRACE", 0.0)
    worker = BlenderProcess([sys.executable, "-c", FAKE])
    with pytest.raises(WorkerDiedError, match="signal 9"):
        worker.ask({"do": "sleep"}, {}, 0.2)


def test_a_command_that_is_no_worker_is_told_apart() -> None:
    with pytest.raises(WorkerDiedError, match="No module named 'nothing'"):
        BlenderProcess([sys.executable, "-c", "import nothing"])


def test_a_worker_leaves_when_its_parent_is_killed(tmp_path: Path) -> None:
    code = f"""
import sys, time
from vig_world.renderers.cycles.process import BlenderProcess
import numpy as np
worker = BlenderProcess([sys.executable, "-c", {FAKE!r}])
print(worker.ask({{}}, {{"x": np.zeros(1)}}, 20)[0]["pid"], flush=True)
time.sleep(60)
"""
    inside = {**os.environ, "TMPDIR": str(tmp_path)}  # the fake worker does not clean up
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=inside) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        os.kill(parent.pid, signal.SIGKILL)
    deadline = time.monotonic() + 5
    while Path(f"/proc/{child}").exists() and "Z" not in Path(f"/proc/{child}/stat").read_text().split()[2]:
        assert time.monotonic() < deadline, "the worker outlived its parent"
        time.sleep(0.02)


def test_a_dead_worker_is_replaced_once_and_then_the_sample_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, library: Library, teapot: ObjectClass, spec: SceneSpec
) -> None:
    script = tmp_path / "worker.py"
    script.write_text(FAKE.replace('header.get("do") == "die"', "True"))
    monkeypatch.setattr(renderer, "WORKER", script)
    started = []
    monkeypatch.setattr(
        renderer, "BlenderProcess", lambda command: started.append(1) or BlenderProcess(command)
    )
    with CyclesRenderer(library, teapot, sys.executable) as cycles:
        with pytest.raises(UserError, match="sample 8 of seed 5: .* two tries: it ended with code 3"):
            cycles.render(spec)
    assert len(started) == 2


def test_a_python_without_blender_is_named_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, library: Library, teapot: ObjectClass, spec: SceneSpec
) -> None:
    script = tmp_path / "worker.py"
    script.write_text("import blender_that_is_not_there")
    monkeypatch.setattr(renderer, "WORKER", script)
    with (
        CyclesRenderer(library, teapot, sys.executable) as cycles,
        pytest.raises(UserError, match="pip install bpy"),
    ):
        cycles.render(spec)


def test_the_interpreter_comes_from_argument_then_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PYTHON_VARIABLE, "/no/such/python")
    assert find_python(sys.executable) == sys.executable
    with pytest.raises(UserError, match=f"interpreter in {PYTHON_VARIABLE}; got '/no/such/python'"):
        find_python()
    monkeypatch.delenv(PYTHON_VARIABLE)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UserError, match="pip install bpy"):
        find_python()


@pytest.mark.parametrize("wrong", [{"samples": 0}, {"threads": 0}, {"recycle": 0}, {"size": 0}])
def test_settings_out_of_range_are_refused(library: Library, teapot: ObjectClass, wrong: dict) -> None:
    with pytest.raises(UserError, match=next(iter(wrong))):
        CyclesRenderer(library, teapot, sys.executable, **wrong)


def test_the_message_holds_the_object_whole(library: Library, teapot: ObjectClass, spec: SceneSpec) -> None:
    header, arrays = compose(library, spec, teapot)
    targets = [n for n, thing in enumerate(header["things"]) if thing["target"]]
    faces = np.concatenate([arrays[f"{n}_faces"] for n in targets])
    assert sorted(map(tuple, faces)) == sorted(map(tuple, teapot.shape_model.faces))
    for number, thing in enumerate(header["things"]):
        assert (thing["material"]["texture"] is None) == (f"{number}_uv" not in arrays)
    again = compose(library, spec, teapot)
    assert again[0] == header and all(np.array_equal(again[1][k], v) for k, v in arrays.items())


def test_a_wide_picture_is_as_high_and_shows_more_at_its_sides(library: Library, teapot: ObjectClass) -> None:
    spec = sample(library, teapot, 5, 8)
    square, wide = (compose(library, spec, teapot, size)[0]["camera"] for size in ((150, 150), (250, 150)))
    assert (wide["width"], wide["height"], wide["cx"]) == (250, 150, square["cx"] + 50)
    same = ("focal", "cy", "rotation", "translation", "roll", "near")
    assert {name: wide[name] for name in same} == {name: square[name] for name in same}


def test_a_larger_picture_is_the_same_view_of_rounder_things(library: Library, teapot: ObjectClass) -> None:
    spec = sample(library, teapot, 5, 8)
    assert spec.coat is not None
    (small, coarse), (large, fine) = (compose(library, spec, teapot, (size, size)) for size in (150, 300))
    assert large["camera"]["width"] == 2 * small["camera"]["width"] == 300
    for name in ("focal", "cx", "cy"):
        assert large["camera"][name] == pytest.approx(2 * small["camera"][name])
    for name in ("rotation", "translation", "distance", "roll"):
        assert large["camera"][name] == small["camera"][name]
    number = next(n for n, thing in enumerate(small["things"]) if thing["target"])
    assert len(fine[f"{number}_faces"]) > 10 * len(coarse[f"{number}_faces"])
    texture = small["things"][number]["material"]["texture"]
    assert len(fine[texture]) == 3 * len(coarse[texture])  # texels of a face, 30 for 10


def test_other_samples_have_other_noise(library: Library, teapot: ObjectClass, spec: SceneSpec) -> None:
    seeds = {
        compose(library, replace(spec, seed=s, index=i), teapot)[0]["seed"] for s in (1, 2) for i in (1, 2)
    }
    assert len(seeds) == 4


def test_a_probe_that_sees_nothing_has_the_panorama_as_its_light() -> None:
    panorama = np.random.default_rng(0).uniform(size=(16, 32, 3)).astype(np.float32)
    light = arriving(np.zeros((8, 16, 4), np.float32), panorama, 0.7)
    expected = rotate_z(project_panorama(panorama).T, 0.7).T
    np.testing.assert_allclose(light, expected)


def test_a_probe_under_a_dark_ceiling_has_the_panoramas_lower_half_alone() -> None:
    """Half of a sphere of radiance 1: L00 = 2 pi Y00, and as much from a ceiling that shines by itself."""
    probe = np.zeros((8, 16, 4), np.float32)
    probe[:4, :, 3] = 1
    white = np.ones((16, 32, 3), np.float32)
    dark = arriving(probe, white, 0.0)
    np.testing.assert_allclose(dark[0], 2 * np.pi * 0.5 / np.sqrt(np.pi), rtol=1e-6)
    assert (dark[2] < -1).all()  # light from below
    probe[:4, :, :3] = 1
    np.testing.assert_allclose(arriving(probe, white, 0.0)[0], 2 * dark[0])


def blender() -> str | None:
    try:
        return find_python()
    except UserError:
        return None


needs_blender = pytest.mark.skipif(blender() is None, reason=f"no Blender; set {PYTHON_VARIABLE}")


@needs_blender
def test_blender_renders_the_same_bytes_whatever_came_before(
    library: Library, teapot: ObjectClass, spec: SceneSpec
) -> None:
    other = sample(library, teapot, 5, 14, "paper")
    with CyclesRenderer(library, teapot, samples=2, threads=1) as cycles:
        first = cycles.render(spec)
        cycles.render(other)
        again = cycles.render(spec)
    with CyclesRenderer(library, teapot, samples=2, threads=2) as cycles:
        two = cycles.render(spec)
    for picture in (again, two):
        assert picture.linear.tobytes() == first.linear.tobytes()
        assert picture.light.tobytes() == first.light.tobytes()


@needs_blender
def test_a_picture_of_another_size_has_labels_of_that_size(library: Library, teapot: ObjectClass) -> None:
    spec = sample(library, teapot, 5, 14, "paper")
    with CyclesRenderer(library, teapot, samples=1, size=64) as cycles:
        picture = cycles.render(spec)
    assert picture.image.shape == picture.linear.shape == (64, 64, 3)
    drawn = render(library, spec, teapot, View.of_scene(spec, teapot, 64))
    for name in ("depth", "amodal", "visible", "by_support", "canvas"):
        assert np.array_equal(getattr(picture, name), getattr(drawn, name))


@needs_blender
def test_what_blender_draws_is_what_the_raster_tier_labels(library: Library, teapot: ObjectClass) -> None:
    """Pure red or pure green: the object's pixels share no light between the two, all others most of it."""
    spec = sample(library, teapot, 5, 14, "paper")
    with CyclesRenderer(library, teapot, samples=4) as cycles:
        picture = cycles.render(spec)
        red = cycles.render(replace(spec, albedo=(0.9, 0.0, 0.0)))
        green = cycles.render(replace(spec, albedo=(0.0, 0.9, 0.0)))
    drawn = render(library, spec, teapot)
    for name in ("depth", "amodal", "visible", "by_support", "canvas"):
        assert np.array_equal(getattr(picture, name), getattr(drawn, name))
    assert picture.light[0] == pytest.approx(EXPOSURE_L00, rel=1e-5)
    changed = np.abs(red.linear - green.linear)[..., :2].sum(-1)
    shown = changed > 0.5 * (red.linear + green.linear)[..., :2].sum(-1)
    iou = (shown & drawn.visible).sum() / (shown | drawn.visible).sum()
    assert iou > 0.9
