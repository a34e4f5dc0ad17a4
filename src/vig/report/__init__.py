"""What the user is shown: pictures of an explanation, its numbers as JSON, its object as GLB."""

from vig.report.files import describe, mask_picture, remove_stale_exports, write_json
from vig.report.glb import glb_from_object, write_glb
from vig.report.pictures import CloseUp, overlay, panels, part_colours

__all__ = [
    "CloseUp",
    "describe",
    "glb_from_object",
    "mask_picture",
    "overlay",
    "panels",
    "part_colours",
    "remove_stale_exports",
    "write_glb",
    "write_json",
]
