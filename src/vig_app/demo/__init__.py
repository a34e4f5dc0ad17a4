"""The photos that `vig demo` explains, path traced, and their truth (README.md describes their making)."""

from dataclasses import dataclass
from pathlib import Path

from vig_app.examples import PackagedPhoto, described_photos

FOLDER = Path(__file__).parent


@dataclass(frozen=True, kw_only=True)
class DemoPhoto(PackagedPhoto):
    """A JPEG of 800 x 800 pixels.

    Attributes:
        title: Description of the photo, in words.
        shows: The class of the object in it; where that is another one, vig has to report so.
        azimuth_deg: Azimuth of the camera, degrees.
        elevation_deg: Elevation of the camera, degrees.
        albedo: (3,) mean of the object, linear RGB.
    """

    title: str
    shows: str
    azimuth_deg: float
    elevation_deg: float
    albedo: tuple[float, ...]

    @property
    def present(self) -> bool:
        """Return whether the photo shows the class that it is explained as."""
        return self.class_name == self.shows


def demo_photos() -> list[DemoPhoto]:
    """Return the packaged photos, in the order in which they are shown."""
    own = ("title", "shows", "azimuth_deg", "elevation_deg")
    return [
        DemoPhoto(
            **fields,
            **{name: about[name] for name in own},
            class_name=about["asked"],
            albedo=tuple(about["albedo"]),
        )
        for about, fields in described_photos(FOLDER, "jpg")
    ]
