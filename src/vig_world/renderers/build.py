"""Turns a SceneSpec into geometry: textured meshes in the world, for path tracers."""

from dataclasses import dataclass, replace

import numpy as np

from vig.scene import ObjectClass
from vig_world.assets.joinery import by_finish
from vig_world.assets.target import target_vertices
from vig_world.assets.things import Material
from vig_world.dataset.spec import SceneSpec
from vig_world.library import Library
from vig_world.mesh import Mesh, vertex_normals

TARGET = "target"


@dataclass(frozen=True)
class Instance:
    """One thing of one material in the world.

    Attributes:
        name: `target`, `wall`, `floor`, `ceiling`, `room-NN` (the rest of the furnished room) or
            `prop-NN/family/part`.
        mesh: Metres, own frame; uv (0, 0) at the texture's bottom left, repeated outside [0, 1].
        normals: (V, 3) unit.
        material: Its material, without a slot's stand-in.
        rotation: (3, 3), from its own frame to the world.
        translation: (3,), metres.
    """

    name: str
    mesh: Mesh
    normals: np.ndarray
    material: Material
    rotation: np.ndarray
    translation: np.ndarray

    @property
    def is_target(self) -> bool:
        """Return whether this is the object."""
        return self.name == TARGET

    def world(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices and normals (V, 3) float32 in the world."""
        rotation = self.rotation.T.astype(np.float32)
        return self.mesh.vertices @ rotation + self.translation.astype(np.float32), self.normals @ rotation


def build(library: Library, spec: SceneSpec, object_class: ObjectClass) -> list[Instance]:
    """Return everything in the scene; the first instance is the object itself."""
    vertices, faces = target_vertices(spec, object_class), object_class.shape_model.faces
    target = Mesh(vertices, faces, np.full((len(vertices), 2), 0.5, np.float32))
    ceramic = Material(np.array(spec.albedo, np.float32).reshape(1, 1, 3), "ceramic", 0.5)
    normals = vertex_normals(vertices, faces)
    instances = [Instance(TARGET, target, normals, ceramic, np.eye(3), np.zeros(3))]
    instances += _room(library, spec)
    for number, placed in enumerate(spec.props):
        pose = (placed.matrix(), np.array(placed.position))
        for part, (mesh, material) in enumerate(library.prop(placed.family, placed.asset).parts):
            name = f"prop-{number:02d}/{placed.family}/{part}"
            instances.append(_instance(name, mesh, material, *pose))
    return instances


def _room(library: Library, spec: SceneSpec) -> list[Instance]:
    """Return the furnished room, one instance for each material or slot."""
    pose = (spec.room.rotation(), np.array(spec.room.origin))
    finishes = dict(spec.room.finishes)
    instances = []
    for number, (mesh, material) in enumerate(by_finish(library.layout(spec.room.layout).parts)):
        name = material.slot if material.slot in ("wall", "floor", "ceiling") else f"room-{number:02d}"
        if material.slot:
            finish = finishes[material.slot]
            texture = library.finish(finish.kind, finish.asset)
            material = replace(material, texture=texture, kind=finish.kind)
            assert mesh.uv is not None
            mesh = Mesh(mesh.vertices, mesh.faces, mesh.uv / np.float32(finish.metres))
        instances.append(_instance(name, mesh, material, *pose))
    return instances


def _instance(
    name: str, mesh: Mesh, material: Material, rotation: np.ndarray, translation: np.ndarray
) -> Instance:
    normals = vertex_normals(mesh.vertices, mesh.faces).astype(np.float32)
    return Instance(name, mesh, normals, material, rotation, translation)
