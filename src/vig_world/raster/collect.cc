// From samples to fragments: a pixel's samples of the same face are one fragment, shaded in their middle.
//
// The body of a function of `Task* const task`; `native.py` puts the declarations before it.

constexpr int S = SAMPLES, n = S * S;
const int W = task->width, columns = W / S, rows = task->height / S;
const float* const q_image = (const float*)task->q;
const int* const id_image = (const int*)task->ids;
const float* const faces = (const float*)task->faces;
VisiblePart* const parts = (VisiblePart*)task->parts;
Fragment* const fragments = (Fragment*)task->fragments;
int* const sorted = (int*)task->sorted;
float* const linear = (float*)task->linear;
float* const depth = (float*)task->depth;
unsigned char* const seen = (unsigned char*)task->seen;
unsigned char* const support = (unsigned char*)task->support;
int count = 0;
for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
        const int pixel = row * columns + column;
        const int corner = row * S * W + column * S;
        int ids[n];
        float nearest = 0;
        for (int y = 0; y < S; ++y)
            for (int x = 0; x < S; ++x) {
                const float q = q_image[corner + y * W + x];
                ids[y * S + x] = id_image[corner + y * W + x];
                nearest = q > nearest ? q : nearest;
            }
        depth[pixel] = 1 / nearest;
        linear[3 * pixel] = linear[3 * pixel + 1] = linear[3 * pixel + 2] = 0;
        int others = 0;
        for (int a = 1; a < n; ++a)
            others |= ids[a] ^ ids[0];
        if (!others) {  // one face, as in most pixels
            seen[pixel] = support[pixel] = 0;
            if (ids[0] >= 0) {
                const int part = ((const int*)(faces + 16 * (size_t)ids[0]))[12];
                VisiblePart& visible = parts[part];
                ++visible.count;
                seen[pixel] = visible.is_target ? n : 0;
                support[pixel] = visible.is_support ? n : 0;
                const float middle = 0.5f * S;
                fragments[count++] = {ids[0], pixel, column * S + middle, row * S + middle, 1.0f, part};
            }
            continue;
        }
        int target = 0, behind = 0;
        for (int a = 0; a < n; ++a) {
            const int id = ids[a];
            if (id < 0)
                continue;
            int same = 0, sum_x = 0, sum_y = 0;
            for (int b = a, y = a / S, x = a - y * S; b < n; ++b) {
                if (ids[b] == id) {
                    ++same;
                    sum_x += x;
                    sum_y += y;
                    ids[b] = -1;
                }
                if (++x == S) {
                    x = 0;
                    ++y;
                }
            }
            const int part = ((const int*)(faces + 16 * (size_t)id))[12];
            VisiblePart& visible = parts[part];
            ++visible.count;
            const float less = 1.0f / same;
            fragments[count++] = {id, pixel, column * S + 0.5f + sum_x * less, row * S + 0.5f + sum_y * less,
                                  (float)same / n, part};
            target += visible.is_target ? same : 0;
            behind += visible.is_support ? same : 0;
        }
        seen[pixel] = target;
        support[pixel] = behind;
    }
// A counting sort by part. `count` of a part becomes the end of its fragments.
int start = 0;
for (int part = 0; part < task->part_count; ++part) {
    const int here = parts[part].count;
    parts[part].count = start;
    start += here;
}
for (int n = 0; n < count; ++n)
    sorted[parts[fragments[n].part].count++] = n;
