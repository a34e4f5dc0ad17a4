"""USD: Z up, metres; a mesh a part with its material, and the photo's camera."""

from pathlib import Path

import numpy as np

from vig.explanation import Explanation
from vig.io.errors import UserError
from vig.io.files import atomic_write
from vig_app.glb import LOOKS_BACK
from vig_app.pictures import part_albedo
from vig_renderer.edges import smooth_normals

FILES = ("object.usdc",)


def write(folder: Path, explanation: Explanation) -> None:
    """Write the scene. Raises UserError where usd-core is not installed."""
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
    except ImportError:
        raise UserError("the export to USD needs usd-core; run pip install 'vig[usd]'") from None
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, f"/{_identifier(explanation.object_class.name)}")
    stage.SetDefaultPrim(root.GetPrim())
    model = explanation.object_class.shape_model
    vertices, colours = explanation.vertices, part_albedo(explanation)
    part_of_face = model.parts[model.faces[:, 0]]
    normals = smooth_normals(vertices, model.faces)
    normals[~normals.any(1)] = 0, 0, 1  # at vertices without area
    for number in np.unique(part_of_face).tolist():
        used, faces = np.unique(model.faces[part_of_face == number], return_inverse=True)
        path = root.GetPath().AppendChild(_identifier(model.part_names[number]))
        mesh = UsdGeom.Mesh.Define(stage, path)
        mesh.CreatePointsAttr([Gf.Vec3f(*row) for row in vertices[used].tolist()])
        mesh.CreateFaceVertexCountsAttr([3] * (faces.size // 3))
        mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        low, high = vertices[used].min(0).tolist(), vertices[used].max(0).tolist()
        mesh.CreateExtentAttr([Gf.Vec3f(*low), Gf.Vec3f(*high)])
        mesh.CreateNormalsAttr([Gf.Vec3f(*row) for row in normals[used].tolist()])
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        colour = Gf.Vec3f(*colours[number].tolist())
        mesh.CreateDisplayColorAttr([colour])
        material = UsdShade.Material.Define(stage, path.AppendChild("material"))
        shader = UsdShade.Shader.Define(stage, path.AppendChild("material").AppendChild("surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(colour)
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    camera = explanation.camera
    eye = UsdGeom.Camera.Define(stage, root.GetPath().AppendChild("camera"))
    # Apertures and focal length share a unit, here the pixel.
    eye.CreateFocalLengthAttr(camera.focal)
    eye.CreateHorizontalApertureAttr(float(camera.width))
    pixel_height = camera.focal / (camera.focal_y or camera.focal)  # in widths of a pixel
    eye.CreateVerticalApertureAttr(pixel_height * camera.height)
    eye.CreateHorizontalApertureOffsetAttr(camera.width / 2 - camera.cx)
    eye.CreateVerticalApertureOffsetAttr(pixel_height * (camera.cy - camera.height / 2))
    eye.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000.0))
    object_from_camera = np.linalg.inv(explanation.camera_from_object) @ LOOKS_BACK
    eye.AddTransformOp().Set(Gf.Matrix4d(*object_from_camera.T.ravel().tolist()))
    with atomic_write(folder / FILES[0]) as temporary:
        stage.GetRootLayer().Export(str(temporary))


def _identifier(name: str) -> str:
    """Return a name as USD takes it: letters, digits and underscores, no digit first."""
    plain = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name)
    return plain if plain[:1].isalpha() else f"_{plain}"
