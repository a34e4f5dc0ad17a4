"""object.glb of an explanation, and scene.glb of several objects of one photo: binary glTF files (GLB)."""

import io
import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vig import __version__
from vig.explanation import Explanation
from vig.io.files import write_bytes
from vig.photo.images import png_bytes
from vig.record import glb_from_object
from vig.scene import Camera, ObjectClass
from vig.several.scene import SceneExplanation
from vig_app.glb.bake import INVENTED, MIRRORED, SEEN, Texture
from vig_app.pictures import part_albedo
from vig_renderer.edges import smooth_normals

LOOKS_BACK = np.diag([1.0, -1.0, -1.0, 1.0])
"""Cameras of glTF, USD and nerfstudio look along -Z with Y up, those of OpenCV along +Z with Y down."""
MAX_SCALED = 1.5  # greatest scale of an object of a scene, so that it stands on the ground of the others
FLOATS, WHOLE = 5126, 5125
VERTICES, CORNERS = 34962, 34963
LINEAR, MIPMAPS, CLAMPED = 9729, 9987, 33071
"""glTF's numbers of types, of uses of a view of the buffer, and of ways to read textures."""


@dataclass(frozen=True, eq=False)
class GlbObject:
    """An object of the file.

    Attributes:
        name: Name of its node and mesh.
        object_class: Its faces and parts; each part is a primitive with a matte material of its name.
        vertices: (V, 3) metres, in the object's frame, in which they are stored.
        colours: (parts, 3) linear RGB in [0, 1].
        node: (4, 4), from there to glTF's frame, Y up.
        texture: Texture in place of the parts' colours.
        extras: Further entries of its node.
    """

    name: str
    object_class: ObjectClass
    vertices: np.ndarray
    colours: np.ndarray
    node: np.ndarray
    texture: Texture | None = None
    extras: dict[str, Any] = field(default_factory=dict)

    @staticmethod
    def of(explanation: Explanation, name: str, *more: Any) -> "GlbObject":
        """Return an explained object; `more` from its node on."""
        return GlbObject(
            name, explanation.object_class, explanation.vertices, part_albedo(explanation), *more
        )


def write_object(path: Path, explanation: Explanation, texture: Texture | None) -> None:
    """Write an object as it was seen, and the camera that saw it.

    Stored positions are those of the object's own frame, so that `camera_from_object` applies to them; the
    node's matrix, `glb_from_object`, makes it upright in viewers.
    """
    node = glb_from_object(float(explanation.latents.azimuth[0]))
    written = GlbObject.of(explanation, explanation.object_class.name, node, texture)
    write_glb(path, [written], explanation.camera, node @ np.linalg.inv(explanation.camera_from_object))


def write_scene(path: Path, scene: SceneExplanation, textures: Sequence[Texture | None]) -> None:
    """Write the objects of a photo on one ground, and the camera that took it, which all are seen by.

    The ground is y = 0. The photo gives size and distance of each object only as their ratio: each is moved
    along its sight until it stands there, and scaled along (`scale` of its node), which leaves the picture
    as it is; by `MAX_SCALED` at most, as something may stand on a shelf.
    """
    shown = scene.shown or range(len(scene.objects))
    poses = [scene.poses[number][1] for number in shown]
    scales, world_from_camera = on_one_ground(poses)
    objects = []
    for number, pose, scale in zip(shown, poses, scales, strict=True):
        node = world_from_camera @ np.diag([scale, scale, scale, 1.0]) @ pose
        about = scene.objects[number], scene.names[number], node, textures[number]
        objects.append(GlbObject.of(*about, {"scale": scale}))
    height, width = scene.objects[0].picture.shape[:2]
    K = scene.poses[0][0]
    camera = Camera(width, height, K[0, 0], K[0, 2], K[1, 2], focal_y=K[1, 1])
    write_glb(path, objects, camera, world_from_camera)


def on_one_ground(poses: Sequence[np.ndarray]) -> tuple[list[float], np.ndarray]:
    """Return the scales with which objects before a camera stand on one ground, its picture unchanged.

    Args:
        poses: (4, 4) camera_from_object of each, metres; the object stands on its z = 0.

    Returns:
        Scale of each about the camera, about 1 in the mean, and world_from_camera (4, 4): Y up, the
        ground at y = 0, the camera above the origin and looking towards -Z.
    """
    up = np.mean([pose[:3, 2] for pose in poses], axis=0)
    up /= np.linalg.norm(up)
    heights = np.array([-up @ pose[:3, 3] for pose in poses])  # heights of the camera above the objects' feet
    # 0.05: height of the camera above an object's foot, over the distance, from which it shows where the
    # ground is
    above = heights > 0.05 * np.linalg.norm([pose[:3, 3] for pose in poses], axis=1)
    height = float(np.exp(np.log(heights[above]).mean())) if above.any() else float(heights.mean())
    scales = np.where(above, height / np.where(above, heights, 1.0), 1.0)
    scales = scales.clip(1 / MAX_SCALED, MAX_SCALED)
    back = np.array([0.0, 0.0, -1.0]) + up[2] * up
    if np.linalg.norm(back) < 1e-6:  # it looks straight down
        back = np.array([0.0, 1.0, 0.0]) - up[1] * up
    back /= np.linalg.norm(back)
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = np.cross(up, back), up, back
    world_from_camera[1, 3] = height
    return scales.tolist(), world_from_camera


def write_glb(
    path: Path, objects: Sequence[GlbObject], camera: Camera, world_from_camera: np.ndarray
) -> None:
    """Write objects and the camera that saw them.

    Args:
        path: Path of the file.
        objects: Each becomes a node and a mesh.
        camera: Camera of the photo.
        world_from_camera: (4, 4) its pose in glTF's frame; camera axes as in OpenCV.
    """
    file = _File()
    for each in objects:
        file.add_object(each)
    file.add_node("camera", world_from_camera @ LOOKS_BACK, camera=0)
    file.described["cameras"] = [_camera(camera)]
    write_bytes(path, file.data())


class _File:
    """A file as it grows: its JSON, and the blocks of its buffer."""

    # By hand: to load a library for it takes half a second of each start of `vig fit`.
    def __init__(self) -> None:
        self.blocks: list[bytes] = []
        self.described: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"vig {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": []}],
        }

    def add(self, kind: str, value: dict[str, Any]) -> int:
        """Add to a list, such as "meshes"; returns the place in it."""
        values: list[dict[str, Any]] = self.described.setdefault(kind, [])
        values.append(value)
        return len(values) - 1

    def add_view(self, block: bytes, **target: int) -> int:
        """Add a block of the buffer; the next begins at a multiple of four bytes."""
        start = sum(map(len, self.blocks))
        self.blocks.append(block + bytes(-len(block) % 4))
        return self.add("bufferViews", {"buffer": 0, "byteLength": len(block), "byteOffset": start} | target)

    def add_floats(self, rows: np.ndarray, bounds: bool = False) -> int:
        """Add an accessor of (N, 2) or (N, 3) numbers of vertices."""
        rows = rows.astype("<f4")
        accessor = {
            "bufferView": self.add_view(rows.tobytes(), target=VERTICES),
            "componentType": FLOATS,
            "count": len(rows),
            "type": f"VEC{rows.shape[1]}",
        }
        extent = {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()} if bounds else {}
        return self.add("accessors", accessor | extent)

    def add_corners(self, faces: np.ndarray) -> int:
        """Add an accessor of faces (N, 3)."""
        view = self.add_view(faces.astype("<u4").tobytes(), target=CORNERS)
        accessor = {"bufferView": view, "componentType": WHOLE, "count": faces.size, "type": "SCALAR"}
        return self.add("accessors", accessor)

    def add_node(self, name: str, matrix: np.ndarray, **rest: Any) -> None:
        """Add a node to the scene."""
        node = self.add("nodes", {"name": name, "matrix": matrix.T.ravel().tolist()} | rest)
        self.described["scenes"][0]["nodes"].append(node)

    def add_object(self, each: GlbObject) -> None:
        """Add an object's node, mesh, materials and texture."""
        model, texture = each.object_class.shape_model, each.texture
        normals = smooth_normals(each.vertices, model.faces)
        normals[~normals.any(1)] = 0, 0, 1  # glTF needs length one at vertices without area, too
        source = slice(None) if texture is None else texture.atlas.source
        attributes = {
            "POSITION": self.add_floats(each.vertices[source], bounds=True),
            "NORMAL": self.add_floats(normals[source]),
        }
        mesh: dict[str, Any] = {"name": each.name}
        faces, surface = model.faces, dict[str, Any]()
        if texture is not None:
            faces = texture.atlas.faces
            attributes["TEXCOORD_0"] = self.add_floats(texture.atlas.coordinates)
            surface, mesh["extras"] = self._add_texture(texture)
        owner = model.parts[model.faces[:, 0]]
        mesh["primitives"] = [
            {
                "attributes": attributes,
                "indices": self.add_corners(faces[owner == number]),
                "material": self._add_material(model.part_names[number], each.colours[number], surface),
            }
            for number in np.unique(owner).tolist()
        ]
        extras = {"extras": each.extras} if each.extras else {}
        self.add_node(each.name, each.node, mesh=self.add("meshes", mesh), **extras)

    def _add_material(self, name: str, colour: np.ndarray, surface: dict[str, Any]) -> int:
        """Add the material of a part; `surface` names a texture, if there is one."""
        surface = surface or {"baseColorFactor": [*colour.tolist(), 1.0]}
        matte = surface | {"metallicFactor": 0, "roughnessFactor": 1}
        extras = {"albedo": colour.tolist()}
        return self.add("materials", {"name": name, "pbrMetallicRoughness": matte, "extras": extras})

    def _add_texture(self, texture: Texture) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the materials' reference to the texture, and the mesh's `extras` on it."""
        photo = io.BytesIO()
        Image.fromarray(texture.picture).save(photo, "JPEG", quality=92, subsampling=0)
        files = (
            (photo.getvalue(), "texture", "jpeg"),
            (png_bytes(texture.origin_picture), "texture_seen", "png"),
        )
        places = [
            self.add("images", {"name": name, "mimeType": f"image/{kind}", "bufferView": self.add_view(data)})
            for data, name, kind in files
        ]
        if "samplers" not in self.described:
            how = {"magFilter": LINEAR, "minFilter": MIPMAPS, "wrapS": CLAMPED, "wrapT": CLAMPED}
            self.add("samplers", how)
        number = self.add("textures", {"source": places[0], "sampler": 0})
        extras = {
            "texture_seen": {
                "image": places[1],
                "values": {"seen": SEEN, "mirrored": MIRRORED, "invented": INVENTED},
                "shares": texture.shares,
            }
        }
        return {"baseColorTexture": {"index": number}}, extras

    def data(self) -> bytes:
        """Return the file's bytes."""
        binary = b"".join(self.blocks)
        text = json.dumps(self.described | {"buffers": [{"byteLength": len(binary)}]}).encode()
        chunks = (b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", binary)
        body = b"".join(struct.pack("<I4s", len(chunk), kind) + chunk for kind, chunk in chunks)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _camera(camera: Camera) -> dict[str, Any]:
    """Return glTF's camera, which has no principal point.

    This one sees the photo and as much beyond as puts that point in the middle; `extras` hold exact numbers.
    """
    half_width = max(camera.cx, camera.width - camera.cx)
    half_height = max(camera.cy, camera.height - camera.cy)
    half_y, half_x = half_height / (camera.focal_y or camera.focal), half_width / camera.focal
    perspective = {"yfov": 2 * math.atan(half_y), "aspectRatio": half_x / half_y, "znear": 0.01}
    extras = {"width": camera.width, "height": camera.height, "K": camera.K.tolist()}
    return {"type": "perspective", "perspective": perspective, "extras": extras}
