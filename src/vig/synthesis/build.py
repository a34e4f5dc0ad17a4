"""Turns a SceneSpec into geometry: textured meshes in the world, for path tracers."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig.files import atomic_write
from vig.scene import Camera, Mesh, ObjectClass, vertex_normals
from vig.synthesis.library import Library
from vig.synthesis.props.material import Material
from vig.synthesis.spec import SceneSpec
from vig.synthesis.target import target_vertices

TARGET = "target"


@dataclass(frozen=True)
class Instance:
    """One thing of one material in the world.

    name: `target`, `wall`, `floor`, `ceiling`, `room-NN` (the rest of the furnished room) or
    `prop-NN/family/part`. key: two instances of the same key have the same mesh, normals and texture, so a
    renderer may keep them. mesh: metres, own frame; uv (0, 0) at the texture's bottom left, repeated outside
    [0, 1]. normals: (V, 3) unit. texture: (h, w, 3) linear albedo, row 0 on top. kind, roughness, emission:
    of the material. rotation (3, 3), translation (3,): from its own frame to the world.
    """

    name: str
    key: str
    mesh: Mesh
    normals: np.ndarray
    texture: np.ndarray
    kind: str
    roughness: float
    emission: float
    rotation: np.ndarray
    translation: np.ndarray

    @property
    def is_target(self) -> bool:
        """Whether this is the object that is to be explained."""
        return self.name == TARGET

    def world(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and normals (V, 3) float32 in the world."""
        rotation = self.rotation.T.astype(np.float32)
        return self.mesh.vertices @ rotation + self.translation.astype(np.float32), self.normals @ rotation


def build(library: Library, spec: SceneSpec, object_class: ObjectClass) -> list[Instance]:
    """Everything in the scene; the first instance is the object itself."""
    vertices, faces = target_vertices(spec, object_class), object_class.shape_model.faces
    target = Mesh(vertices, faces, np.full((len(vertices), 2), 0.5, np.float32))
    albedo = np.array(spec.albedo, np.float32).reshape(1, 1, 3)
    normals = vertex_normals(vertices, faces)
    still = (np.eye(3), np.zeros(3))
    instances = [Instance(TARGET, "", target, normals, albedo, "ceramic", 0.5, 0.0, *still)]
    instances += _room(library, spec)
    for number, placed in enumerate(spec.props):
        pose = (placed.matrix(), np.array(placed.position))
        for part, (mesh, stuff) in enumerate(library.prop(placed.family, placed.asset).parts):
            name = f"prop-{number:02d}/{placed.family}/{part}"
            key = f"{placed.family}/{placed.asset}/{part}"
            instances.append(_instance(name, key, mesh, stuff, stuff.texture, *pose))
    return instances


def _room(library: Library, spec: SceneSpec) -> list[Instance]:
    """The furnished room, one instance for each material or slot."""
    pose = (spec.room.rotation(), np.array(spec.room.origin))
    finishes = dict(spec.room.finishes)
    instances = []
    for number, (mesh, stuff) in enumerate(joined(library.layout(spec.room.layout).parts)):
        texture, key, kind = stuff.texture, f"layout-{spec.room.layout}/{number}", stuff.kind
        if stuff.slot:
            finish = finishes[stuff.slot]
            texture, kind = library.finish(finish.kind, finish.asset), finish.kind
            key += f"/{finish.kind}-{finish.asset}-{finish.metres}"
            assert mesh.uv is not None
            mesh = Mesh(mesh.vertices, mesh.faces, mesh.uv / np.float32(finish.metres))
        name = stuff.slot if stuff.slot in ("wall", "floor", "ceiling") else f"room-{number:02d}"
        instances.append(_instance(name, key, mesh, stuff, texture, *pose, kind=kind))
    return instances


def _instance(
    name: str,
    key: str,
    mesh: Mesh,
    stuff: Material,
    texture: np.ndarray,
    rotation: np.ndarray,
    translation: np.ndarray,
    kind: str | None = None,
) -> Instance:
    normals = vertex_normals(mesh.vertices, mesh.faces).astype(np.float32)
    material = (kind or stuff.kind, stuff.roughness, stuff.emission)
    return Instance(name, key, mesh, normals, texture, *material, rotation, translation)


def joined(parts: Iterable[tuple[Mesh, Material]]) -> list[tuple[Mesh, Material]]:
    """The same surfaces with one mesh for each material, or each slot, in the order of first use."""
    groups: dict[str | int, tuple[Material, list[Mesh]]] = {}
    for mesh, stuff in parts:
        groups.setdefault(stuff.slot or id(stuff), (stuff, []))[1].append(mesh)
    return [(_joined(meshes), stuff) for stuff, meshes in groups.values()]


def _joined(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    blank = [np.zeros((len(mesh.vertices), 2), np.float32) for mesh in meshes]
    uvs = [other if mesh.uv is None else mesh.uv for mesh, other in zip(meshes, blank, strict=True)]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return Mesh(vertices, np.concatenate(faces).astype(np.int32), np.concatenate(uvs))


def export(library: Library, spec: SceneSpec, object_class: ObjectClass, path: Path) -> None:
    """Write a scene for a path tracer: `path`.npz with the arrays and `path`.json with the rest.

    The npz holds `N_vertices`, `N_faces`, `N_uv`, `N_normals` and `N_texture` of instance N, and `panorama`
    (H, W, 3), linear radiance at the paper's exposure but not yet turned by the spec's panorama_angle. The
    json holds the list of instances (name, kind, roughness, emission), the camera (K and camera_from_world,
    OpenCV) and the spec.
    """
    instances = build(library, spec, object_class)
    arrays: dict[str, Any] = {"panorama": library.radiance(spec.panorama)}
    for number, instance in enumerate(instances):
        vertices, normals = instance.world()
        for key, value in (
            ("vertices", vertices),
            ("faces", instance.mesh.faces),
            ("uv", instance.mesh.uv),
            ("normals", normals.astype(np.float32)),
            ("texture", instance.texture),
        ):
            arrays[f"{number}_{key}"] = value
    camera = Camera.standard(target_height=object_class.target_height)
    rotation, translation = camera.pose(torch.tensor([spec.azimuth]), torch.tensor([spec.elevation]))
    described = {
        "instances": [
            {"name": i.name, "kind": i.kind, "roughness": i.roughness, "emission": i.emission}
            for i in instances
        ],
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
