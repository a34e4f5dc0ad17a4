"""The words of an explanation's page."""

import math
from typing import Any

import numpy as np

from vig.inference.presence import MIN_PRESENT
from vig.scene import Latents


def view_words(latents: Latents, probability: float) -> str:
    """Describe a view (B = 1) and the probability that it is right."""
    azimuth, elevation = (math.degrees(float(angle[0])) for angle in (latents.azimuth, latents.elevation))
    words = f"azimuth {azimuth % 360:.0f}°, elevation {elevation:.0f}°, {likely_right(probability)}"
    return words.removesuffix(", ")


def likely_right(probability: float) -> str:
    """Return the probability that a view is right, in words; nothing for a NaN."""
    return "" if math.isnan(probability) else f"{probability:.0%} likely right"


def table_rows(described: dict[str, Any]) -> list[tuple[str, str]]:
    """Return name and words of each line of the page's table."""
    deviation, camera = described["deviation"], described["camera"]
    hidden, absent = described["hidden_fraction"], described["verdict"] == "absent"
    rows = []
    for name, key in (("azimuth of the eye", "azimuth_deg"), ("its elevation", "elevation_deg")):
        interval = ""
        if absent:
            interval = ", of the fit that was rejected"
        elif deviation[key] is not None:
            # 1.645: standard deviations to either side that hold 90 % of a Gaussian
            width = 1.645 * deviation[key]
            interval = f", 90 % interval ±{width:.0f}°" if width < 90 else ", if this is the right view"
        rows.append((name, f"{described[key]:.0f}°{interval}"))
    return rows + [
        ("roll of the photo", f"{round(described['roll_deg'])}°"),
        ("hidden", "nothing of it is in the photo" if hidden is None else f"{hidden:.0%} of the object"),
        ("kind", f"{described['class']}" + (f", {described['family']}" if described["family"] else "")),
        ("light", _light(described["light"])),
        ("focal length", f"{camera['K'][0][0]:.0f} pixels, {camera['focal_from']}"),
        ("scale", camera["scale"]),
    ]


def badge(described: dict[str, Any]) -> str:
    """Return the verdict, which is of the view, and that on the mask where it differs."""
    verdict, mask = described["verdict"], "mask" in described["trusted"]
    if described["mask_confidence"] is None or (verdict == "trusted") == mask:
        return str(verdict)
    return f"view {verdict}, mask {'trusted' if mask else 'not'}"


def summary(described: dict[str, Any]) -> str:
    """Return class, trusted parts with their probabilities, and the share hidden."""
    confidence, hidden = described["confidence"], described["hidden_fraction"]
    if described["verdict"] == "absent":
        if described["present"] is None:  # stated, not estimated
            return f"{described['class']}: none; below is the fit that was dismissed"
        return (
            f"{described['class']}: in the photo with a probability of {_round_down(described):.0%}, below"
            f" the {MIN_PRESENT:.0%} needed; below is the fit at the likeliest place, which was rejected"
        )
    if confidence is None:
        confidences = "how sure was not learned"
    else:
        confidences = f"the view is right with a probability of {confidence:.0%}"
        if (mask_right := described["mask_confidence"]) is not None:
            confidences += f", the mask of {mask_right:.0%}"
    if described["present"] is not None:
        confidences = f"in the photo with a probability of {described['present']:.0%}; if so, {confidences}"
    view, mask = (part in described["trusted"] for part in ("view", "mask"))
    trusted = {
        (True, True): "its view and its mask are trusted",
        (True, False): "its view is trusted, its mask is not",
        (False, True): "its mask is trusted, its view is not",
        (False, False): "neither its view nor its mask is trusted",
    }[view, mask]
    hidden_share = "" if hidden is None else f"; {hidden:.0%} of it is hidden"
    return f"{described['class']}: {trusted} ({confidences}){hidden_share}"


def _round_down(described: dict[str, Any]) -> float:
    """Return the probability of presence in whole percent, at most: below a bound it never reads as that."""
    return math.floor(100 * described["present"]) / 100


def probabilities(described: dict[str, Any]) -> list[tuple[str, float]]:
    """Return the answer's probabilities with labels, as far as they were learned; then other views'."""
    named = (("in the photo", "present"), ("view right", "confidence"), ("mask right", "mask_confidence"))
    known = [(name, described[key]) for name, key in named if described[key] is not None]
    if described["verdict"] == "absent":
        return [(f"in the photo ({MIN_PRESENT:.0%} needed)", _round_down(described))]
    others = [
        (f"or azimuth {view['azimuth_deg']:.0f}°", view["probability"]) for view in described["alternatives"]
    ]
    return known + [(name, probability) for name, probability in others if probability is not None]


def views_note(described: dict[str, Any]) -> str:
    """Return advice on the views."""
    if described["alternatives"]:
        other = described["alternatives"][0]["azimuth_deg"]
        return (
            f"The search tried these. To take the second one: vig fit --azimuth {other:.0f}, or choose it in"
            " vig view."
        )
    return "The search found no other view worth telling."


def _light(light: list[float]) -> str:
    """Return the direction of most light, by the first order of its SH coefficients, in the object's
    frame.
    """
    y, z, x = light[1:4]
    above = "from above" if z > 0.5 * float(np.hypot(x, y)) else "from the side"
    directedness = float(np.linalg.norm([x, y, z])) / max(abs(light[0]), 1e-6)
    kind = "soft" if directedness < 0.4 else "directed" if directedness < 0.9 else "strongly directed"
    return f"{kind}, most of it {above}"
