"""The interpretable parameters of a mug, and the named designs in `designs.json`."""

from dataclasses import dataclass

from vig_world.assets.designs.catalogue import load_catalogue


@dataclass(frozen=True)
class MugDesign:
    """One mug or cup: lengths in metres, angles in degrees, the rest ratios.

    The body's axis is x = y = 0, the handle points to +X, the foot stands on z = 0.
    """

    name: str
    # Body: radius along the height, a straight taper changed by a bulge, a flare and a rounded corner.
    height: float = 0.095
    radius: float = 0.041  # outer, at the rim, before flare
    base_ratio: float = 1.0  # the same at the bottom / radius, before the corner
    bulge: float = 0.0  # radius beyond the taper's, at bulge_height, / radius; negative: a waist
    bulge_height: float = 0.45  # / height
    flare: float = 0.0  # radius beyond the taper's at the rim / radius
    flare_start: float = 0.6  # height from which it flares / height
    corner_height: float = 0.006  # height of the quarter ellipse between bottom and wall
    corner_inset: float = 0.004  # its width
    squareness: float = 0.0  # 0 round .. 1 nearly square section
    foot_height: float = 0.003
    foot_inset: float = (
        0.002  # how far the foot stands back from the corner's lower end; negative: it spreads
    )
    # Wall
    wall: float = 0.004  # thickness
    floor: float = 0.006  # thickness above the foot
    lip: float = 0.8  # thickness at the rim / wall
    rim_bead: float = 0.0  # how far a rolled rim stands out from the wall
    rim_roundness: float = 1.0  # 0.3 cut flat .. 1 round .. 1.5 pointed
    # Handle: a centre line in the plane y = 0 from its lower place on the wall, up a grip, to its upper one.
    handle_top: float = 0.075  # heights of the two places
    handle_bottom: float = 0.03
    handle_reach: float = 0.029  # the grip's centre beyond the wider of the two places
    handle_peak: float = 0.52  # height of the grip's middle between bottom (0) and top (1)
    handle_flat: float = 0.2  # length of its straight piece / (top - bottom)
    handle_lean: float = 0.0  # how far the grip leans out at the top
    handle_rise: float = 8.0  # direction of the upper end above the horizon, seen from the body
    handle_drop: float = -6.0  # direction of the lower end above the horizon, seen from the body
    handle_upper_roundness: float = 0.6  # 0.2 slanting .. 0.55 round .. 0.95 squared
    handle_lower_roundness: float = 0.6
    handle_softness: float = 0.03  # how far corners are rounded / length of the centre line
    # Its section
    handle_thickness: float = 0.009  # in the loop's plane
    handle_width: float = 0.014  # across it
    handle_squareness: float = 0.2  # 0 elliptic .. 1 nearly rectangular
    handle_taper: float = 0.92  # size at the lower end / at the upper end
    handle_flare: float = 1.3  # size where it meets the wall / size of the grip


MUGS = load_catalogue(MugDesign, __package__)  # by split; the shape model is learned from "train"
