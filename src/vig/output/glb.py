"""The explained object as a binary glTF file (GLB)."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vig import __version__
from vig.io.files import atomic_write
from vig.renderer.shading import smooth_normals
from vig.scene import Camera, ObjectClass

Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""glTF's axes (Y up) from the object's (Z up)."""
LOOKS_BACK = np.diag([1.0, -1.0, -1.0, 1.0])
"""Cameras of glTF, USD and nerfstudio look along -Z with Y up, those of OpenCV along +Z with Y down."""


def glb_from_object(azimuth: float) -> np.ndarray:
    """(4, 4): Y up, and turned about the vertical so that an eye at the azimuth (radians) is on +Z.

    Viewers look from there.
    """
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    turn = np.array([[cos, sin, 0, 0], [-sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    stands: np.ndarray = Y_UP @ turn
    return stands


def write_glb(
    path: Path,
    vertices: np.ndarray,
    colours: np.ndarray,
    object_class: ObjectClass,
    camera: Camera,
    azimuth: float,
    elevation: float,
) -> None:
    """Write an object as it was seen, and the camera that saw it.

    Stored positions are those of the object's own frame, so that `camera_from_object` applies to them; the
    node's matrix, `glb_from_object`, makes it upright in viewers.

    Args:
        path: Of the file.
        vertices: (V, 3) metres, in the object's frame.
        colours: (parts, 3) linear RGB in [0, 1]; each part is a primitive with a matte material of its name.
        object_class: Its faces and parts.
        camera: That of the photo.
        azimuth: Radians, as elevation.
        elevation: Of the eye.
    """
    model = object_class.shape_model
    owner = model.parts[model.faces[:, 0]]
    numbers = np.unique(owner).tolist()
    indices = [model.faces[owner == number].astype("<u4") for number in numbers]
    normals = smooth_normals(torch.from_numpy(vertices), torch.from_numpy(model.faces)).numpy()
    normals[~normals.any(1)] = 0, 0, 1  # glTF wants length one of vertices without area, too
    blocks = [vertices.astype("<f4"), normals.astype("<f4"), *indices]
    accessors: list[dict[str, Any]] = [
        {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"}
        | {"min": blocks[0].min(0).tolist(), "max": blocks[0].max(0).tolist()},
        {"bufferView": 1, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
    ]
    accessors += [
        {"bufferView": 2 + place, "componentType": 5125, "count": faces.size, "type": "SCALAR"}
        for place, faces in enumerate(indices)
    ]
    offsets = np.cumsum([0, *(block.nbytes for block in blocks)]).tolist()
    views = [
        {
            "buffer": 0,
            "byteLength": block.nbytes,
            "byteOffset": offset,
            "target": 34962 if place < 2 else 34963,
        }
        for place, (block, offset) in enumerate(zip(blocks, offsets, strict=False))
    ]
    stands = glb_from_object(azimuth)
    eye = stands @ np.linalg.inv(camera.camera_from_world(azimuth, elevation)) @ LOOKS_BACK
    described = {
        "asset": {"version": "2.0", "generator": f"vig {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"name": object_class.name, "mesh": 0, "matrix": stands.T.ravel().tolist()},
            {"name": "camera", "camera": 0, "matrix": eye.T.ravel().tolist()},
        ],
        "meshes": [
            {
                "name": object_class.name,
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2 + place, "material": place}
                    for place in range(len(indices))
                ],
            }
        ],
        "materials": [
            {
                "name": model.part_names[number],
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*colours[number].tolist(), 1.0],
                    "metallicFactor": 0,
                    "roughnessFactor": 1,
                },
            }
            for number in numbers
        ],
        "cameras": [_camera(camera)],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offsets[-1]}],
    }
    # By hand: to load a library for it takes half a second of each start of `vig fit`.
    text = json.dumps(described).encode()
    data = b"".join(block.tobytes() for block in blocks)
    parts = (b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", data)
    body = b"".join(struct.pack("<I4s", len(part), kind) + part for kind, part in parts)
    with atomic_write(path) as temporary:
        Path(temporary).write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)


def _camera(camera: Camera) -> dict[str, Any]:
    """glTF's camera, which has no principal point.

    This one sees the photo and as much beyond it as puts that point in the middle; `extras` hold the exact
    numbers.
    """
    half_width = max(camera.cx, camera.width - camera.cx)
    half_height = max(camera.cy, camera.height - camera.cy)
    half_y, half_x = half_height / (camera.focal_y or camera.focal), half_width / camera.focal
    perspective = {
        "yfov": 2 * math.atan(half_y),
        "aspectRatio": half_x / half_y,
        "znear": 0.01,
    }
    extras = {"width": camera.width, "height": camera.height, "K": camera.K.tolist()}
    return {"type": "perspective", "perspective": perspective, "extras": extras}
