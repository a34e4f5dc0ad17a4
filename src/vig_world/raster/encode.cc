// Linear light to 8-bit sRGB by tables, exactly rounded.
//
// The body of a function of `Task* const task`; `native.py` puts the declarations before it.

const int values = 3 * (task->width / SAMPLES) * (task->height / SAMPLES);
const float* const linear = (const float*)task->linear;
const unsigned char* const encode = (const unsigned char*)task->encode;
const float* const thresholds = (const float*)task->thresholds;
unsigned char* const image = (unsigned char*)task->image;
for (int n = 0; n < values; ++n) {
    const float value = linear[n] < 1 ? linear[n] : 1;
    const int level = encode[(int)(value * BINS)];
    image[n] = level + (value >= thresholds[level + 1]);
}
