"""The interpretable parameters of a teapot, and the named designs in `designs.json`."""

from dataclasses import dataclass
from typing import Literal, get_args

from vig_world.assets.designs.catalogue import load_catalogue

Handle = Literal["behind", "above", "straight"]
"""An ear behind the body; a bail over the lid, from shoulder to shoulder; or a straight grip behind."""
HANDLES: tuple[Handle, ...] = get_args(Handle)


@dataclass(frozen=True)
class TeapotDesign:
    """One teapot: lengths in metres, angles in degrees, the rest ratios.

    The body's axis is x = y = 0, the spout points to +X, the handle to -X, the foot stands on z = 0.
    Heights are above z = 0 unless the comment says otherwise.
    """

    name: str
    # Body: a curve from the foot's top over the belly (the widest place) to the shoulder's top, then a neck.
    belly_radius: float = 0.098
    belly_height: float = 0.062
    belly_aspect: float = 1.0  # width (y) / length (x) of the body's section
    squareness: float = 0.0  # 0 round .. 1 nearly square section, at the belly
    lid_squareness: float = 0.0  # the same at rim and lid
    lobes: int = 0  # how many ribs or flat sides the body has round its axis, 0 for none
    lobe_depth: float = 0.0  # ribs: amplitude / radius
    lobe_flatness: float = 0.0  # flat sides: 0 round .. 1 a polygon of `lobes` sides
    base_radius: float = 0.055  # where the body meets the foot
    base_fullness: float = 0.55  # 0 a cone below the belly .. 0.55 round .. 1 nearly a cylinder
    shoulder_height: float = 0.116  # the top of the body's curve
    neck_radius: float = 0.048
    upper_fullness: float = 0.55  # how long the body stays wide above the belly
    shoulder_reach: float = 0.55  # how long it runs level towards the neck: 0 .. 1 from the belly's edge
    neck_sweep: float = 0.0  # how steeply it meets the neck: 0 level .. 0.5 upright (pear, bottle)
    neck_height: float = 0.004
    rim_flare: float = 0.0  # rim radius beyond the neck's
    # Foot
    foot_height: float = 0.006
    foot_flare: float = 1.04  # foot's radius at z = 0 / base_radius
    # Lid
    lid_height: float = 0.018  # dome above the lid's edge
    lid_overhang: float = 0.002  # lid radius beyond the rim's; negative: set into the rim
    lid_roundness: float = 0.5  # 0 a cone .. 0.5 round .. 1 a flat-topped drum
    lid_thickness: float = 0.004
    # Knob
    knob_height: float = 0.018
    knob_radius: float = 0.011
    knob_waist: float = 0.55  # narrowest radius / knob_radius
    knob_base: float = 0.8  # radius at the lid / knob_radius
    knob_bulge: float = 0.62  # height of its widest place / knob_height
    knob_flatness: float = 0.55  # 0 a pointed top .. 0.55 round .. 1 a flat top
    # Spout
    spout_base_height: float = 0.052
    spout_reach: float = 0.038  # the mouth's centre beyond belly_radius
    spout_tip_height: float = 0.112
    spout_base_angle: float = 22.0  # direction of the centre line above the horizon
    spout_tip_angle: float = 50.0
    spout_bend: float = 0.4  # 0 straight .. 0.6 pronounced curve
    spout_base_radius: float = 0.019
    spout_tip_radius: float = 0.0095
    spout_taper: float = 1.4  # 1 a cone .. 3 narrowing mostly near the base
    spout_ellipticity: float = 1.1  # height / width of its section at the base
    mouth_tilt: float = 22.0  # how far the lower lip runs ahead of a square cut
    # Handle
    handle: Handle = "behind"
    bail_height: float = 0.075  # above: the centre line's top above the lid's
    bail_span: float = 0.75  # above: radius at which its ends meet the shoulder / belly_radius
    bail_swell: float = 0.1  # above: how far it bows out beyond its ends / belly_radius
    bail_shift: float = 0.0  # above: x of its top / belly_radius
    # Behind, and straight where a comment says so
    handle_top: float = 0.100
    handle_bottom: float = 0.040
    handle_reach: float = 0.035  # its centre line's outermost point beyond belly_radius; straight too
    handle_peak: float = 0.6  # height of the outermost point between bottom (0) and top (1)
    handle_rise: float = 15.0  # direction of its upper end above the horizon; straight: the grip's
    handle_drop: float = 10.0  # direction of its lower end above the horizon, seen from the body
    handle_upper_roundness: float = 0.6  # 0.3 pointed .. 0.55 round .. 0.9 squared; above: shape of the arc
    handle_lower_roundness: float = 0.55
    handle_thickness: float = 0.012  # in the loop's plane; straight: half the grip's
    handle_width: float = 0.016  # across it
    handle_squareness: float = 0.2  # shape of its section: 0 elliptic .. 1 nearly rectangular


TEAPOTS = load_catalogue(TeapotDesign, __package__)  # by split; the shape model is learned from "train"
