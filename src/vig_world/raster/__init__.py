"""The throughput rasteriser: scenes as pictures, shaded with nine light coefficients.

    mug = PackedAsset.of(prop.parts)                      # once for each asset
room = PackedAsset.of(layout.parts)
items = [
    Item(room, turn, shift, 0, {"wall": (TextureLevels.of(texture), 0.6)}, is_support=True),
    Item(mug, rotation, translation, owner=1),
]
target = Target.of(object_class, vertices, shape, albedo, light)
picture = draw(items, target, View.of(object_class, azimuth, elevation), light)
far, owner = depth(items, View.of(object_class, azimuth, elevation, 75))"""
