// Adds the colours of the object's samples to the pixels that they lie in.
//
// Samples of a pixel follow each other, as `surface` has left them. The body of a function of
// `Task* const task`; `native.py` puts the declarations before it.

constexpr int n = SAMPLES * SAMPLES;
const float* const colours = (const float*)task->colours;
const int* const pixels = (const int*)task->places;
const unsigned char* const seen = (const unsigned char*)task->seen;
float* const linear = (float*)task->linear;
const int count = task->surface_count;
for (int start = 0, end = 0; start < count; start = end) {
    const int pixel = pixels[start];
    float sums[3] = {0, 0, 0};
    for (; end < count && pixels[end] == pixel; ++end)
        for (int channel = 0; channel < 3; ++channel)
            sums[channel] += colours[(size_t)channel * count + end];
    for (int channel = 0; channel < 3; ++channel)
        linear[3 * pixel + channel] += wp::min(wp::max(sums[channel], 0.0f), (float)seen[pixel]) / n;
}
