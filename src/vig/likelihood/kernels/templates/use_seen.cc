// The vertices of the faces that an image's pixels from `first` to `end` show are used, and have rows.
const wp::int64* const key = (const wp::int64*)keys.data + (size_t)image * keys.shape.dims[1];
wp::uint8* const used = (wp::uint8*)vertices.used.data + (size_t)image * vertices.used.shape.dims[1];
for (int pixel = first; pixel < end; ++pixel) {
    if (key[pixel] == NOTHING)
        continue;
    const int* const corners = (const int*)mesh.faces.data + 3 * (int)(key[pixel] & FACE_MASK);
    used[corners[0]] = used[corners[1]] = used[corners[2]] = 2;
}
