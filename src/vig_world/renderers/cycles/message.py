"""Encodes a scene as a message to `blender/worker.py`."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from vig.scene import IMAGE_SIZE, ObjectClass
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.raster.view import View
from vig_world.renderers.build import Instance, build
from vig_world.renderers.cycles.appearance import (
    FINE_FROM,
    TEXELS,
    TEXELS_FINE,
    appearance,
    bake_texture,
    coat_material,
    lambertian,
)
from vig_world.renderers.cycles.rounding import round_mesh
from vig_world.streams import stream

SHELL = ("wall", "ceiling")
"""Instances that the camera sees from inside, and that let the panorama's light through."""

Message = tuple[dict[str, Any], dict[str, np.ndarray]]


def compose(
    library: Library,
    spec: SceneSpec,
    object_class: ObjectClass,
    size: tuple[int, int] = (IMAGE_SIZE, IMAGE_SIZE),
) -> Message:
    """Return header and arrays of everything in the scene, seen in an image of width x height pixels.

    The renderer adds sampling settings.

    The header holds `things` (material, shell, target), `camera`, `angle`, `seed` and the probe's height;
    the arrays are `N_vertices` (V, 3), `N_normals` (V, 3), `N_faces` (F, 3) and, where thing N has a texture,
    `N_uv` (F, 3, 2), further `texture_*` (h, w, 3) and `panorama` (H, W, 3).
    """
    # the random stream of noise and materials
    rng = stream(spec.seed, spec.index, spec.split, 2**20 + 2)
    noise_seed = int(rng.integers(2**31))
    instances = build(library, spec, object_class)
    fine = min(size) >= FINE_FROM
    scene = _SceneMessage(fine)
    for instance in instances:
        if instance.is_target:
            if spec.coat is None:
                scene.add(instance, lambertian(instance.material.texture[0, 0]))
            else:
                texels = TEXELS_FINE if fine else TEXELS
                pixels, uv = bake_texture(spec.coat, instance.mesh.vertices, object_class.shape_model, texels)
                scene.add(instance, coat_material(spec.coat, scene.texture(pixels)), uv=uv)
        else:
            scene.add(instance, _material(scene, instance, rng), shell=instance.name in SHELL)
    scene.arrays["panorama"] = library.surroundings(spec.panorama).astype(np.float32)
    view = View.of_scene(spec, object_class, size)
    header = {
        "seed": noise_seed,
        "angle": spec.panorama_angle,
        "things": scene.things,
        "camera": {
            **asdict(view.camera),
            "near": view.near,
            "rotation": view.rotation.tolist(),
            "translation": view.translation.tolist(),
        },
        "probe": {"z": object_class.target_height},
    }
    return header, scene.arrays


class _SceneMessage:
    """The things and arrays of a message under construction."""

    def __init__(self, fine: bool) -> None:
        self._fine = fine
        self.things: list[dict[str, Any]] = []
        self.arrays: dict[str, np.ndarray] = {}
        self._textures: dict[int, str] = {}

    def add(
        self, instance: Instance, material: dict[str, Any], shell: bool = False, uv: np.ndarray | None = None
    ) -> None:
        """Add an instance, with texture coordinates `uv` (F, 3, 2) in place of its own."""
        number, mesh = len(self.things), instance.mesh
        faces = mesh.faces
        self.things.append({"material": material, "shell": shell, "target": instance.is_target})
        vertices, normals = instance.world()
        corners = None
        if material["texture"]:
            assert uv is not None or mesh.uv is not None
            corners = mesh.uv[faces] if uv is None and mesh.uv is not None else uv
        if self._fine:
            vertices, normals, faces, corners = round_mesh(vertices, normals, faces, corners)
        self.arrays[f"{number}_vertices"] = vertices.astype(np.float32)
        self.arrays[f"{number}_normals"] = normals.astype(np.float32)
        self.arrays[f"{number}_faces"] = faces.astype(np.int32)
        if corners is not None:
            self.arrays[f"{number}_uv"] = np.asarray(corners, np.float32)

    def texture(self, pixels: np.ndarray) -> str:
        """Return the name under which a texture (h, w, 3) is sent, once however often it is used."""
        name = self._textures.setdefault(id(pixels), f"texture_{len(self._textures)}")
        self.arrays[name] = np.asarray(pixels, np.float32)
        return name


def _material(scene: _SceneMessage, instance: Instance, rng: np.random.Generator) -> dict[str, Any]:
    material = instance.material
    name = scene.texture(material.texture) if material.texture.shape[:2] != (1, 1) else None
    if instance.name in SHELL and material.kind == "paint":
        material = replace(material, kind="plaster")  # emulsion, not lacquer
    return appearance(material, name, rng)
