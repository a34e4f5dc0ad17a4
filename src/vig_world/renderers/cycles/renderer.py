"""The Cycles renderer: path traces scenes with Blender in a separate process."""

import importlib.util
import os
import shutil
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from vig.io.errors import UserError
from vig.scene import EXPOSURE_L00, IMAGE_SIZE, ObjectClass, rotate_z, srgb8_from_linear
from vig_world.assets.panoramas.light import grey, project_panorama
from vig_world.dataset.spec import SampleError, SceneSpec
from vig_world.library import Library
from vig_world.raster.picture import Picture
from vig_world.raster.view import View
from vig_world.renderers.cycles.message import compose
from vig_world.renderers.cycles.process import BlenderProcess, WorkerDiedError
from vig_world.renderers.rasterized import render

WORKER = Path(__file__).parent / "blender" / "worker.py"
PYTHON_VARIABLE = "VIG_BLENDER_PYTHON"
"""The environment variable that names an interpreter which can import bpy."""
INSTALL = "python3.11 -m venv blender && blender/bin/pip install bpy 'numpy<2'"
TIMEOUT, TIMEOUT_PER_SAMPLE = 120.0, 3.0
"""Time limit of one scene in seconds, and its increase per path per pixel, in proportion to the pixels of
larger images; a scene is tried twice."""


@dataclass(frozen=True)
class TracedPicture(Picture):
    """A path-traced sample: masks and depth are the rasteriser's, the rest is from Cycles.

    `light` is grey, of the light that arrives at the object's place without the object, L00 = EXPOSURE_L00.

    Attributes:
        linear: (H, W, 3) float32, content of `image`, not clipped.
        gain: (3,) factor of the panorama's radiance in each channel: exposure and white balance.
    """

    linear: np.ndarray
    gain: np.ndarray


class CyclesRenderer:
    """Renders scenes in one worker process, which is started when it is first needed.

    Use it as a context manager, or call `close`.

    Args:
        library: The assets of scenes.
        object_class: The object's class.
        python: An interpreter that can import bpy; None takes the environment variable `VIG_BLENDER_PYTHON`,
            then the running one.
        samples: Paths per pixel.
        threads: Threads of the worker.
        recycle: Scenes after which the worker is replaced by a fresh one.
        size: Pixels of pictures, masks and depth: a side, or width and height.
        normals: Whether pictures have normals, the rasteriser's as masks and depth.

    Raises:
        UserError: For a missing interpreter with bpy, or an argument out of range.
    """

    def __init__(
        self,
        library: Library,
        object_class: ObjectClass,
        python: str | None = None,
        samples: int = 32,
        threads: int = 1,
        recycle: int = 200,
        size: int | tuple[int, int] = IMAGE_SIZE,
        normals: bool = False,
    ) -> None:
        self._size = (size, size) if isinstance(size, int) else size
        counts = {"samples": samples, "threads": threads, "recycle": recycle, "size": min(self._size)}
        for name, value in counts.items():
            if value < 1:
                raise UserError(f"{name} must be at least 1; got {value}")
        self._library, self._object_class = library, object_class
        self._command = [find_python(python), str(WORKER), str(threads)]
        self._samples = samples
        self._recycle, self._normals = recycle, normals
        pixels = self._size[0] * self._size[1]
        self._timeout = TIMEOUT + TIMEOUT_PER_SAMPLE * samples * max(1.0, pixels / IMAGE_SIZE**2)
        self._worker: BlenderProcess | None = None
        self._served = 0
        self.timing: dict[str, float] = {}
        """Seconds of the last scene as the worker saw it: `build_s`, `image_s`, `probe_s`, `cpu_s`."""

    def render(self, spec: SceneSpec) -> TracedPicture:
        """Path trace a scene; the same spec gives the same bytes, whatever was rendered before.

        Raises:
            SampleError: When Blender failed to answer twice, or no light reaches the object.
        """
        header, arrays = compose(self._library, spec, self._object_class, self._size)
        header["samples"] = self._samples
        probe_height, probe_samples = 64, 16
        header["probe"] |= {"height": probe_height, "samples": probe_samples}
        name = f"sample {spec.index} of seed {spec.seed}"
        answer, traced = self._ask(header, arrays, name)
        self.timing = answer
        probe = arriving(traced["probe"], arrays["panorama"], spec.panorama_angle)
        if not (probe[0] > 0).all():
            raise SampleError(
                f"{name}: expected light at the object's place; got none. Choose another panorama."
            )
        gain = EXPOSURE_L00 / probe[0]
        linear = traced["image"] * gain.astype(np.float32)
        view = View.of_scene(spec, self._object_class, self._size)
        drawn = render(self._library, spec, self._object_class, view, self._normals)
        picture = {field.name: getattr(drawn, field.name) for field in fields(Picture)}
        light = grey(probe * gain).astype(np.float32)
        picture |= {"image": srgb8_from_linear(linear), "light": light}
        return TracedPicture(**picture, linear=linear, gain=gain)

    def close(self) -> None:
        """End the worker process."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None

    def __enter__(self) -> "CyclesRenderer":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _ask(
        self, header: dict[str, Any], arrays: dict[str, np.ndarray], name: str
    ) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the worker's answer; a dead worker is replaced once."""
        why = ""
        for _ in range(2):
            if self._worker is None:
                self._worker, self._served = self._start(), 0
            try:
                answer, traced = self._worker.ask(header, arrays, self._timeout)
            except WorkerDiedError as death:
                self._worker, why = None, str(death)
                continue
            except BaseException:  # Ctrl-C in the middle of an answer
                self.close()
                raise
            if "error" in answer:
                raise RuntimeError(f"{name}: {answer['error']}")
            self._served += 1
            if self._served >= self._recycle:
                self.close()
            return answer, traced
        raise SampleError(f"{name}: expected a picture from Blender; got none in two tries: it {why}")

    def _start(self) -> BlenderProcess:
        try:
            return BlenderProcess(self._command)
        except WorkerDiedError as death:
            raise UserError(
                f"expected {self._command[0]} to run Blender as a module; it {death}."
                f" Install it in an environment of its own: {INSTALL}"
            ) from None


def arriving(probe: np.ndarray, panorama: np.ndarray, angle: float) -> np.ndarray:
    """Return SH (9, 3) of the light at a probe, world frame.

    Args:
        probe: (h, 2h, 4), its picture of the scene, with coverage.
        panorama: (H, 2H, 3), visible through the gaps. Both have the panorama's columns, which are to be
            turned by `angle` radians about +Z.
    """
    height, width = panorama.shape[:2]
    rows = (2 * np.arange(height) + 1) * len(probe) // (2 * height)
    columns = (2 * np.arange(width) + 1) * probe.shape[1] // (2 * width)
    gaps = 1 - probe[rows[:, None], columns, 3:]
    light = project_panorama(probe[..., :3]) + project_panorama(panorama * gaps)
    return rotate_z(light.T, angle).T


def find_python(python: str | None = None) -> str:
    """Return the interpreter for Blender: `python`, `VIG_BLENDER_PYTHON`, or the running one if it has bpy.

    Raises:
        UserError: When there is none, or the named one is missing.
    """
    named = python or os.environ.get(PYTHON_VARIABLE)
    if named:
        path = shutil.which(named)
        if path is None:
            origin = "the argument" if python else PYTHON_VARIABLE
            raise UserError(f"expected a Python interpreter in {origin}; got '{named}'. Check the path.")
        return path
    if importlib.util.find_spec("bpy"):
        return sys.executable
    raise UserError(
        f"the Cycles renderer needs Blender as a module. Install it in an environment of its own: {INSTALL};"
        f" then set {PYTHON_VARIABLE} to blender/bin/python"
    )
