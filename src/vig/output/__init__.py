"""What the user is shown: pictures of an explanation, its numbers as JSON, its object as GLB."""

from vig.output.glb import glb_from_object, write_glb
from vig.output.json import describe, mask_picture, write_json
from vig.output.pictures import CloseUp, overlay, panels, part_colours

__all__ = [
    "CloseUp",
    "describe",
    "glb_from_object",
    "mask_picture",
    "overlay",
    "panels",
    "part_colours",
    "write_glb",
    "write_json",
]
