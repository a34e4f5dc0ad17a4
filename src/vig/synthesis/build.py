"""Turns a SceneSpec into geometry: textured meshes in the world, for the raster tier and for path tracers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from vig.files import atomic_write
from vig.scene import Camera, Mesh, ObjectClass, vertex_normals
from vig.synthesis import assets
from vig.synthesis.room import room_meshes
from vig.synthesis.spec import Placed, SceneSpec, Split


@dataclass(frozen=True)
class Instance:
    """One thing of one material in the world.

    name: `target`, a surface of the room (`wall`, `floor`, `ceiling`, `table`) or `prop-NN/family/part`.
    mesh: metres, world frame; uv (0, 0) at the texture's bottom left, repeated outside [0, 1].
    normals: (V, 3) unit. texture: (h, w, 3) linear albedo, row 0 on top. kind, roughness: of the material.
    """

    name: str
    mesh: Mesh
    normals: np.ndarray
    texture: np.ndarray
    kind: str
    roughness: float

    @property
    def is_target(self) -> bool:
        """Whether this is the object that is to be explained."""
        return self.name == "target"


def target_vertices(spec: SceneSpec, object_class: ObjectClass) -> np.ndarray:
    """The object's vertices (V, 3) float32, metres."""
    coefficients = torch.tensor(spec.shape, dtype=torch.float32)[None]
    return object_class.shape_model.vertices(coefficients)[0].numpy()


def build(spec: SceneSpec, object_class: ObjectClass) -> list[Instance]:
    """Everything in the scene; the first instance is the object itself."""
    vertices, faces = target_vertices(spec, object_class), object_class.shape_model.faces
    uv = np.full((len(vertices), 2), 0.5, np.float32)
    albedo = np.array(spec.albedo, np.float32).reshape(1, 1, 3)
    target = Mesh(vertices, faces, uv)
    instances = [Instance("target", target, vertex_normals(vertices, faces), albedo, "ceramic", 0.5)]
    for name, mesh, finish in room_meshes(spec.room):
        normals = vertex_normals(mesh.vertices, mesh.faces)
        texture = assets.surface(spec.split, finish)
        instances.append(Instance(name, mesh, normals, texture, finish.kind, 0.6))
    for number, placed in enumerate(spec.props):
        instances += _prop_instances(number, placed, spec.split)
    return instances


def _prop_instances(number: int, placed: Placed, split: Split) -> list[Instance]:
    rotation = Rotation.from_rotvec(placed.rotation).as_matrix().T.astype(np.float32)
    whole, normals = _prop_arrays(split, placed.family, placed.asset)
    vertices = whole @ rotation + np.array(placed.position, np.float32)
    normals = normals @ rotation
    instances, start = [], 0
    for part, (mesh, stuff) in enumerate(assets.prop(split, placed.family, placed.asset).parts):
        chosen = slice(start, start := start + len(mesh.vertices))
        moved = Mesh(vertices[chosen], mesh.faces, mesh.uv)
        name = f"prop-{number:02d}/{placed.family}/{part}"
        instances.append(Instance(name, moved, normals[chosen], stuff.texture, stuff.kind, stuff.roughness))
    return instances


@lru_cache(maxsize=4096)
def _prop_arrays(split: Split, family: str, asset: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and normals (V, 3) float32 of a whole prop in its own frame."""
    parts = assets.prop(split, family, asset).parts
    meshes = [mesh for mesh, _ in parts]
    normals = [vertex_normals(mesh.vertices, mesh.faces) for mesh in meshes]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return vertices, np.concatenate(normals).astype(np.float32)


def export(spec: SceneSpec, object_class: ObjectClass, path: Path) -> None:
    """Write a scene for a path tracer: `path`.npz with the arrays and `path`.json with the rest.

    The npz holds `N_vertices`, `N_faces`, `N_uv`, `N_normals` and `N_texture` of instance N, and `panorama`
    (H, W, 3), linear radiance at the paper's exposure but not yet turned by the spec's panorama_angle. The
    json holds the list of instances (name, kind, roughness), the camera (K and camera_from_world, OpenCV)
    and the spec.
    """
    instances = build(spec, object_class)
    arrays: dict[str, Any] = {"panorama": assets.radiance(spec.split, spec.panorama)}
    for number, instance in enumerate(instances):
        for key, value in (
            ("vertices", instance.mesh.vertices),
            ("faces", instance.mesh.faces),
            ("uv", instance.mesh.uv),
            ("normals", instance.normals.astype(np.float32)),
            ("texture", instance.texture),
        ):
            arrays[f"{number}_{key}"] = value
    camera = Camera.standard(target_height=object_class.target_height)
    rotation, translation = camera.pose(torch.tensor([spec.azimuth]), torch.tensor([spec.elevation]))
    described = {
        "instances": [{"name": i.name, "kind": i.kind, "roughness": i.roughness} for i in instances],
        "camera": {
            "width": camera.width,
            "height": camera.height,
            "K": [[camera.focal, 0, camera.cx], [0, camera.focal, camera.cy], [0, 0, 1]],
            "rotation": rotation[0].tolist(),
            "translation": translation[0].tolist(),
        },
        "spec": json.loads(spec.to_json()),
    }
    with atomic_write(path.with_suffix(".npz")) as temporary:
        np.savez(temporary, **arrays)
    with atomic_write(path.with_suffix(".json")) as temporary:
        temporary.write_text(json.dumps(described))
