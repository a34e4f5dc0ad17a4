"""Scene of a photo that vig explained: `blender --python scene.py`, or run it in Blender's text editor.

It makes a scene "vig" of the files beside it: the object, the camera that took the photo with the photo as
its background, and the light as a world. vig itself does not import it.
"""

import json
from pathlib import Path

import bpy
import numpy as np

text = getattr(bpy.context.space_data, "text", None)
folder = Path(bpy.path.abspath(text.filepath) if text and text.filepath else __file__).resolve().parent
about = json.loads((folder / "scene.json").read_text())
width, height, ((focal, _, center_x), (_, focal_y, center_y), _) = about["width"], about["height"], about["K"]
pixel = focal / focal_y  # height of a pixel over its width

scene = bpy.data.scenes.new("vig")
with bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0], collection=scene.collection):
    bpy.ops.import_scene.gltf(filepath=str(folder / "object.glb"))
render = scene.render
render.engine, render.film_transparent, scene.view_settings.view_transform = "CYCLES", True, "Standard"
render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
render.pixel_aspect_x, render.pixel_aspect_y = max(1, 1 / pixel), max(1, pixel)

# glTF has no principal point: its camera stands where it should, and sees more.
scene.camera = next(each for each in scene.objects if each.type == "CAMERA")
camera = scene.camera.data
camera.sensor_fit, camera.sensor_width, camera.lens = "HORIZONTAL", 36, 36 * focal / width
camera.shift_x, camera.shift_y = 0.5 - center_x / width, pixel * (center_y - height / 2) / width
background = camera.background_images.new()
background.image, background.alpha = bpy.data.images.load(str(folder / "photo.png")), 1
background.frame_method, camera.show_background_images = "STRETCH", True

radiance = np.load(folder / "light.npy")
panorama = bpy.data.images.new("light", *radiance.shape[1::-1], float_buffer=True)
panorama.colorspace_settings.name = "Non-Color"
panorama.pixels.foreach_set(radiance.ravel())
panorama.pack()
scene.world = bpy.data.worlds.new("light")
scene.world.use_nodes = True
nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
sky = nodes.new("ShaderNodeTexEnvironment")
sky.image = panorama
links.new(sky.outputs["Color"], next(each for each in nodes if each.type == "BACKGROUND").inputs["Color"])

if bpy.context.window:  # none in the background
    bpy.context.window.scene = scene
    for area in bpy.context.window.screen.areas:
        if area.type == "VIEW_3D":
            area.spaces.active.region_3d.view_perspective = "CAMERA"
