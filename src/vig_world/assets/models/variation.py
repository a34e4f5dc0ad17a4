"""Variation without end of the packaged models: other proportions, colours and textures."""

import numpy as np

from vig_world.assets.materials import ROUGHNESS, slot_material
from vig_world.assets.shapes import scale_mesh
from vig_world.assets.textures import BRIGHTEST, DARKEST, colour, near, texture
from vig_world.assets.things import Furniture, Material, Parts
from vig_world.mesh import Mesh, face_normals

STRETCH = 0.1
"""Range of the factor by which each axis of a prop differs from the model's; half as much of furniture."""
SIZE = 0.15  # range of the factor of a prop's size
OWN_COLOURS, TEXTURED = 0.45, 0.25
"""Shares of props with the model's colours, and with a procedural texture; the others are of one or two
colours of any household thing."""
PATTERNS = {
    "wood": ("wood",),
    "cloth": ("cloth", "stripes", "floral", "weave", "checker", "speckle"),
    "paper": ("print", "stripes", "floral", "wallpaper"),
    "ceramic": ("speckle", "marble", "wallpaper", "stripes", "floral"),
    "metal": ("paint",),
    "glass": ("paint",),
}
"""Textures by kind of material; others are any of `ANY`."""
ANY = ("paint", "speckle", "stripes", "checker", "marble", "wallpaper", "terrazzo", "wood", "leather")


def vary(parts: Parts, rng: np.random.Generator) -> Parts:
    """Return a prop's parts in other proportions, with other colours or textures; metres."""
    size = (1 + rng.uniform(-SIZE, SIZE)) * (1 + rng.uniform(-STRETCH, STRETCH, 3))
    style = rng.random()
    largest = max(float(np.ptp(mesh.vertices, axis=0).max()) for mesh, _ in parts)
    first, second = colour(rng), colour(rng)
    areas = [
        float(np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1).sum()) for mesh, _ in parts
    ]
    result = []
    for (mesh, stuff), area in zip(parts, areas, strict=True):
        has_picture = stuff.texture.size > 3
        main = area >= 0.25 * max(areas)
        if style < OWN_COLOURS or stuff.emission or (has_picture and rng.random() < 0.75):
            image = stuff.texture * near(np.full(3, 0.5), rng, 0.15) * 2
        elif style < OWN_COLOURS + TEXTURED and main and not has_picture:
            pattern = PATTERNS.get(stuff.kind, ANY)
            image = texture(str(rng.choice(pattern)), rng, 64, first if rng.random() < 0.5 else None)
            repeats = 1 / (largest * rng.uniform(0.4, 1.2))
            assert mesh.uv is not None
            mesh = Mesh(mesh.vertices, mesh.faces, (mesh.uv * repeats).astype(np.float32))
        elif stuff.kind == "leaf":
            image = near(stuff.texture.mean((0, 1)), rng, 0.4).reshape(1, 1, 3)
        else:
            image = near(first if main else second, rng, 0.1).reshape(1, 1, 3)
        roughness = float(rng.uniform(*ROUGHNESS[stuff.kind]))
        image = image.clip(DARKEST, BRIGHTEST).astype(np.float32)
        result.append((scale_mesh(mesh, size), Material(image, stuff.kind, roughness, "", stuff.emission)))
    return tuple(result)


def vary_furniture(piece: Furniture, rng: np.random.Generator) -> Furniture:
    """Return a piece in other proportions; its slots get stand-ins, other parts a like or another colour."""
    x, y, z = (1 + rng.uniform(-STRETCH / 2, STRETCH / 2, 3)).tolist()
    repainted = rng.random() < 0.4
    stand_ins = {slot: slot_material(slot, rng) for slot in ("wood", "top", "fabric")}
    parts = []
    for mesh, stuff in piece.parts:
        if stuff.slot:
            stuff = stand_ins[stuff.slot]
        elif stuff.texture.size == 3 and not stuff.emission:
            base = (
                colour(rng) if repainted and stuff.kind not in ("metal", "glass", "leaf") else stuff.texture
            )
            image = near(np.reshape(base, 3), rng, 0.15).reshape(1, 1, 3)
            stuff = Material(image, stuff.kind, stuff.roughness)
        parts.append((scale_mesh(mesh, (x, y, z)), stuff))
    supports = tuple(support.stretch(x, y, z) for support in piece.supports)
    return Furniture(piece.family, tuple(parts), supports)
