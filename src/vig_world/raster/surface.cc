// Where on the object's surface the samples that show it lie: for colours that are found outside.
//
// Goes through pixels row by row, and 16 samples side by side. The body of a function of `Task* const task`;
// `native.py` puts the declarations before it.

constexpr int S = SAMPLES;
const int W = task->width, columns = W / S, rows = task->height / S, stride = W * task->height;
const int* const id_image = (const int*)task->ids;
const float* const faces = (const float*)task->faces;
const VisiblePart* const parts = (const VisiblePart*)task->parts;
const unsigned char* const seen = (const unsigned char*)task->seen;
float* const surface = (float*)task->surface;
int* const places = (int*)task->places;
float back[3][3], eye[3];  // world from camera
for (int r = 0; r < 3; ++r) {
    double sum = 0;
    for (int c = 0; c < 3; ++c) {
        back[r][c] = task->rotation[c][r];
        sum -= task->rotation[c][r] * task->translation[c];
    }
    eye[r] = sum;
}
const float inverse_focal = 1 / task->focal;
int count = 0, waiting = 0, face_of[LANES];
float px[LANES], py[LANES];
auto flush = [&]() {
    float a[5][LANES], b[5][LANES], c[5][LANES], ax[LANES], ay[LANES], aq[LANES], bq[LANES], cq[LANES];
    float bdx[LANES], bdy[LANES], cdx[LANES], cdy[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        const float* const face = faces + 16 * (size_t)face_of[lane < waiting ? lane : 0];
        const int* const corner = (const int*)face + 9;
        const float* const attributes = (const float*)parts[corner[3]].attributes;
        ax[lane] = face[0]; ay[lane] = face[1]; aq[lane] = face[2]; bq[lane] = face[3]; cq[lane] = face[4];
        bdx[lane] = face[5]; bdy[lane] = face[6]; cdx[lane] = face[7]; cdy[lane] = face[8];
        for (int n = 0; n < 5; ++n) {
            a[n][lane] = attributes[5 * corner[0] + n];
            b[n][lane] = attributes[5 * corner[1] + n];
            c[n][lane] = attributes[5 * corner[2] + n];
        }
    }
    for (int lane = 0; lane < LANES; ++lane) {
        const float off_x = px[lane] - ax[lane], off_y = py[lane] - ay[lane];
        const float to_b = bdx[lane] * off_x + bdy[lane] * off_y;
        const float to_c = cdx[lane] * off_x + cdy[lane] * off_y;
        const float z = 1 / (aq[lane] + to_b * (bq[lane] - aq[lane]) + to_c * (cq[lane] - aq[lane]));
        const float wb = to_b * bq[lane] * z, wc = to_c * cq[lane] * z, wa = 1 - wb - wc;
        const float x = (px[lane] - task->cx) * inverse_focal, y = (py[lane] - task->cy) * inverse_focal;
        float* const out = surface + count + lane;
        if (lane < waiting) {
            for (int r = 0; r < 3; ++r)
                out[r * stride] = eye[r] + z * (back[r][0] * x + back[r][1] * y + back[r][2]);
            for (int n = 0; n < 4; ++n)
                out[(3 + n) * stride] = wa * a[n][lane] + wb * b[n][lane] + wc * c[n][lane];
            places[stride + count + lane] = (int)a[4][lane];
        }
    }
    count += waiting;
    waiting = 0;
};
for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
        const int pixel = row * columns + column;
        if (!seen[pixel])
            continue;
        for (int sample = 0; sample < S * S; ++sample) {
            const int y = row * S + sample / S, x = column * S + sample % S, id = id_image[y * W + x];
            if (id < 0 || !parts[((const int*)(faces + 16 * (size_t)id))[12]].is_target)
                continue;
            places[count + waiting] = pixel;
            face_of[waiting] = id;
            px[waiting] = x + 0.5f;
            py[waiting] = y + 0.5f;
            if (++waiting == LANES)
                flush();
        }
    }
flush();
task->surface_count = count;
