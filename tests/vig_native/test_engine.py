"""The native library as a module: what it refuses, and that every instruction set gives the same bits."""

import importlib
import os
import platform
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import vig_native
from vig.likelihood import Geometry
from vig.scene import ObjectClass
from vig_native.processor import instruction_sets

BUILT = [name for name in instruction_sets() if find_spec(f"vig_native._{name}")]
SIZE = 60


def arguments(teapot: ObjectClass, real: type = np.float32) -> dict[str, dict[str, Any]]:
    """Return arguments of `geometry`, `photos` and a few points of a teapot, by these names."""
    model, rng = teapot.shape_model, np.random.default_rng(0)
    made = Geometry(model)
    layout = made.layout
    blocks = [layout.at(name) for name in ("azimuth", "elevation", "albedo", "light", "framing")]
    rings = made.rings
    geometry = {
        "layout": [layout.size, layout.at("shape"), model.modes, *blocks],
        "positions": made.positions.astype(real),
        "faces": made.faces,
        "edges": made.edges,
        "ring_start": rings[0],
        "ring": rings[1],
        "reflectance": made.reflectance.astype(real),
        "transfer": teapot.transfer.astype(real),
    }
    camera = teapot.camera(SIZE)
    eye = camera.focal, camera.cx, camera.cy, camera.target_height, camera.distance, SIZE, SIZE
    photos = {
        "camera": eye,
        "observed": rng.uniform(0.2, 0.7, (1, SIZE * SIZE, 3)).astype(real),
        "log_prior": np.log(rng.dirichlet([2, 2, 2], (1, SIZE * SIZE))).astype(real),
        "stride": 1,
        "exact": True,
        "density": 0,
    }
    points = np.zeros((4, layout.size), real)
    points[:, layout["shape"]] = rng.normal(0, 0.5, (4, model.modes))
    points[:, layout.at("azimuth")] = rng.uniform(0, 6, 4)
    points[:, layout.at("elevation")] = rng.uniform(0, 1.2, 4)
    points[:, layout["albedo"]] = rng.uniform(0.3, 0.7, (4, 3))
    points[:, layout["light"]] = rng.normal(0, 0.2, (4, 9))
    points[:, layout.at("light")] = 2.3
    at = {"points": points, "photo": np.zeros(4, np.int32), "sigma": np.full(4, 0.05)}
    return {"geometry": geometry, "photos": photos, "points": at}


def results(engine: ModuleType, given: dict[str, dict[str, Any]], threads: int = 1) -> list[np.ndarray]:
    """An evaluation of the points and a search from them."""
    geometry, photos = engine.geometry(**given["geometry"]), engine.photos(**given["photos"])
    valued = engine.evaluate(geometry, photos, **given["points"], order=2, images=True, threads=threads)
    points = given["points"]["points"]
    size, none = points.shape[1], np.zeros(0, points.dtype)
    azimuth, light = given["geometry"]["layout"][3], given["geometry"]["layout"][6]
    mean, precision = np.zeros(size, points.dtype), np.eye(size, dtype=points.dtype)
    prior = engine.prior(mean, precision, none, none, none, 0.0, 1.0, azimuth, light)
    bound = np.full(size, 9, points.dtype)
    limits = 5, 0.1, 0.1, 1e4  # iterations, tolerance, damping, give_up
    searched = engine.search(geometry, photos, prior, 0, 0.05, points, -bound, bound, *limits, True, threads)
    return [*valued, *searched]


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("name", BUILT[1:])
def test_every_instruction_set_gives_the_same_bits(name: str, real: type, teapot: ObjectClass) -> None:
    given = arguments(teapot, real)
    widest, other = (importlib.import_module(f"vig_native._{each}") for each in (BUILT[0], name))
    for one, two in zip(results(widest, given), results(other, given), strict=True):
        np.testing.assert_array_equal(one, two)


def test_threads_give_the_same_bits(teapot: ObjectClass) -> None:
    given = arguments(teapot)
    for one, two in zip(results(vig_native.engine, given), results(vig_native.engine, given, 3), strict=True):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize(
    ("part", "name", "value", "message"),
    [
        ("geometry", "faces", np.full((3, 3), 10**6, np.int32), "faces must be from 0 to"),
        ("geometry", "faces", np.zeros((3, 4), np.int32), r"faces must be \(any, 3\); got \(3, 4\)"),
        (
            "geometry",
            "edges",
            np.array([[0, 1, 0, 5, -9]], np.int32),
            "edges has numbers out of range in row 0",
        ),
        ("geometry", "layout", [3, 0, 16, 1, 1, 1, 1, 1], "layout has blocks beyond its size"),
        ("photos", "observed", np.zeros((1, 5, 3), np.float32), r"observed must be \(any, 3600, 3\)"),
        ("photos", "stride", 0, "stride must be 1 or more"),
        ("points", "photo", np.full(4, 7, np.int32), "photo must be from 0 to 0; they are from 7 to 7"),
        ("points", "points", np.zeros((4, 5), np.float32), "points must be"),
        ("points", "sigma", np.zeros(3), r"sigma must be \(4\); got \(3\)"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(
    part: str, name: str, value: Any, message: str, teapot: ObjectClass
) -> None:
    given = arguments(teapot)
    given[part][name] = value
    with pytest.raises(ValueError, match=message):
        results(vig_native.engine, given)


def test_the_widest_set_that_the_processor_has_is_taken(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text("model name: x\nflags\t\t: fpu sse2 avx2 fma\n")
    assert instruction_sets(tmp_path / "cpuinfo") == ["avx2", "plain"]
    assert instruction_sets(tmp_path / "none") == ["plain"]
    if "VIG_ISA" not in os.environ:
        assert vig_native.ISA == BUILT[0]


def test_a_set_that_is_not_installed_is_named() -> None:
    run = subprocess.run(
        [sys.executable, "-c", "import vig_native"],
        env=os.environ | {"VIG_ISA": "avx1024"},
        capture_output=True,
        text=True,
    )
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith(
        "ImportError: expected vig's native library for avx1024; this installation has none."
    )


NO_THREADS = """
import ctypes
import numpy as np
from tests.vig_native.test_engine import arguments
from vig.scene import ObjectClass
from vig_native import engine

given = arguments(ObjectClass.load("teapot"))
things = engine.geometry(**given["geometry"]), engine.photos(**given["photos"])
points = np.repeat(given["points"]["points"], 500, 0)
whose = points, np.zeros(2000, np.int32), np.full(2000, 0.05)
expected = engine.evaluate(*things, *whose, 0, False, 1)[0]
libc, attributes = ctypes.CDLL(None), ctypes.create_string_buffer(256)
assert not libc.pthread_attr_init(attributes)
assert not libc.pthread_attr_setstacksize(attributes, ctypes.c_size_t(1 << 46))
assert not libc.pthread_setattr_default_np(attributes)
assert libc.pthread_create(ctypes.byref(ctypes.c_void_p()), None, libc.getpid, None)
assert np.array_equal(engine.evaluate(*things, *whose, 0, False, 8)[0], expected)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="asks for stacks that glibc cannot give")
def test_work_that_gets_no_thread_is_done_by_the_caller() -> None:
    root = Path(__file__).parents[2]
    run = subprocess.run([sys.executable, "-c", NO_THREADS], cwd=root, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("iterations", [-1, 2**31 - 1])
def test_a_search_takes_a_number_of_steps(iterations: int) -> None:
    bound = np.ones(1)
    with pytest.raises(ValueError, match="iterations must be 0 to 1,000,000"):
        vig_native.engine.search_function(
            lambda point, derivatives: (0.0, None, None),
            bound[None],
            -bound,
            bound,
            iterations,
            0.1,
            0.1,
            1.0,
        )


def test_links_that_leave_the_image_are_no_links() -> None:
    """All pixels speak for hidden, whatever a link beyond the border would carry."""
    free, alone = np.ones((1, 4, 5), bool), np.full((1, 4, 5), -3, np.int32)
    links = np.full((1, 8, 4, 5), 2**31 - 1, np.int32)
    assert not vig_native.engine.minimum_cut(free, alone, links).any()


def test_results_are_written_into_what_was_given_or_refused(teapot: ObjectClass) -> None:
    size, none = 12, np.zeros(0, np.float32)
    mean, precision = np.zeros(size, np.float32), np.eye(size, dtype=np.float32)
    prior = vig_native.engine.prior(mean, precision, none, none, none, 0.0, 1.0, 0, 1)
    value = np.zeros(1)
    prior.add_to(np.ones((1, size), np.float32), value, None, None)
    assert value[0] == -size / 2
    with pytest.raises(TypeError):
        prior.add_to(np.ones((1, size), np.float32), np.zeros(1, np.float32), None, None)
