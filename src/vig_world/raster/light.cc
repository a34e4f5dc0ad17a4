// Lights the object's vertices as the model does: their attributes become normal, irradiance and number.
//
// The body of a function of `Target* const task`; `native.py` puts the declarations before it.

// Area-weighted vertex normals, and with them irradiance and the areas that vertices stand for.
const float* const vertices = (const float*)task->vertices;
const float* const added = (const float*)task->added;
char* const asset = (char*)task->asset;
Header& header = *(Header*)asset;
const int* const corners = (const int*)(asset + header.corners);
float* const positions = (float*)(asset + header.positions);
float* const attributes = (float*)(asset + header.attributes);
float* const points = (float*)(asset + header.points);
const float* const E = task->irradiance;
const int V = header.vertex_count;
float low[3], high[3];
for (int r = 0; r < 3; ++r)
    low[r] = high[r] = vertices[r];
for (int v = 0; v < V; ++v) {
    for (int r = 0; r < 3; ++r) {
        const float place = vertices[3 * v + r];
        positions[r * V + v] = points[4 * v + r] = place;
        low[r] = place < low[r] ? place : low[r];
        high[r] = place > high[r] ? place : high[r];
        attributes[5 * v + r] = 0;
    }
    points[4 * v + 3] = 0;
}
float radius = 0;
Part& part = *(Part*)(asset + header.parts);
for (int r = 0; r < 3; ++r) {
    header.sphere[r] = part.sphere[r] = 0.5f * (low[r] + high[r]);
    radius += 0.25f * (high[r] - low[r]) * (high[r] - low[r]);
}
header.sphere[3] = part.sphere[3] = 1.0001f * sqrtf(radius);
for (int face = 0; face < header.face_count; ++face) {
    const int* const corner = corners + 3 * face;
    const float* const a = vertices + 3 * corner[0];
    const float* const b = vertices + 3 * corner[1];
    const float* const c = vertices + 3 * corner[2];
    const float bx = b[0] - a[0], by = b[1] - a[1], bz = b[2] - a[2];
    const float cx = c[0] - a[0], cy = c[1] - a[1], cz = c[2] - a[2];
    const float x = by * cz - bz * cy, y = bz * cx - bx * cz, z = bx * cy - by * cx;
    const float third = sqrtf(x * x + y * y + z * z) * (1.0f / 6);
    for (int m = 0; m < 3; ++m) {
        attributes[5 * corner[m]] += x;
        attributes[5 * corner[m] + 1] += y;
        attributes[5 * corner[m] + 2] += z;
        points[4 * corner[m] + 3] += third;
    }
}
for (int v = 0; v < V; ++v) {
    float* const n = attributes + 5 * v;
    const float length = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]), unit = length > 0 ? 1 / length : 0;
    const float x = n[0] * unit, y = n[1] * unit, z = n[2] * unit;
    float e = E[0] + E[1] * y + E[2] * z + E[3] * x + E[4] * x * y + E[5] * y * z + E[6] * (3 * z * z - 1)
        + E[7] * x * z + E[8] * (x * x - y * y);
    e += added ? added[v] : 0;
    n[0] = x;
    n[1] = y;
    n[2] = z;
    n[3] = e > 0 ? e : 0;
    n[4] = v;
}
