"""What the user is shown: pictures of an explanation, its numbers as JSON."""

from vig.output.json import Y_UP, describe, glb_from_object, mask_picture, write_json
from vig.output.pictures import CloseUp, overlay, panels, part_colours

__all__ = [
    "Y_UP",
    "CloseUp",
    "describe",
    "glb_from_object",
    "mask_picture",
    "overlay",
    "panels",
    "part_colours",
    "write_json",
]
