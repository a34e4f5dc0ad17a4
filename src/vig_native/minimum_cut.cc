#include <algorithm>
#include <vector>

#include "images.h"

namespace vig {

// Evidence for hidden flows over the links to evidence for visible; a pixel is visible if its own evidence
// is not used up, or if a link leads from it to such a pixel. Heights are distances to these, found anew after every
// few relabellings.
void minimum_cut(int height, int width, const uint8_t* free, const int32_t* alone, int32_t* links, uint8_t* visible) {
    const int size = height * width, far = size + 1;
    std::vector<int> above(size), queue(size);
    std::vector<int64_t> surplus(size), wanted(size);
    const int steps[8] = {1, -1, width, -width, width + 1, -width - 1, width - 1, 1 - width};
    for (int p = 0; p < size; ++p) {
        surplus[p] = free[p] && alone[p] < 0 ? -(int64_t)alone[p] : 0;
        wanted[p] = free[p] && alone[p] > 0 ? alone[p] : 0;
    }
    // Links lead only from free pixels to free ones: others have no room.
    while (true) {
        int first = 0, last = 0;
        for (int p = 0; p < size; ++p) {
            above[p] = wanted[p] > 0 ? 1 : far;
            if (wanted[p] > 0)
                queue[last++] = p;
        }
        for (; first < last; ++first) {
            const int to = queue[first];
            for (int way = 0; way < 8; ++way) {
                // The link back of a step is the one that leads here.
                const int from = to + steps[way];
                if (from >= 0 && from < size && above[from] == far && links[(size_t)(way ^ 1) * size + from] > 0) {
                    above[from] = above[to] + 1;
                    queue[last++] = from;
                }
            }
        }
        // The queue becomes a ring of the pixels that have a surplus and a way on.
        int count = 0, relabelled = 0;
        for (int p = 0; p < size; ++p)
            if (surplus[p] > 0 && above[p] < far)
                queue[count++] = p;
        if (count == 0)
            break;
        for (int at = 0; count > 0 && relabelled < size; at = at + 1 < size ? at + 1 : 0, --count) {
            const int p = queue[at];
            while (surplus[p] > 0 && above[p] < far) {
                int least = far;
                if (wanted[p] > 0) {
                    const int64_t amount = std::min(surplus[p], wanted[p]);
                    surplus[p] -= amount;
                    wanted[p] -= amount;
                    least = wanted[p] > 0 ? 0 : far;
                }
                for (int way = 0; way < 8 && surplus[p] > 0; ++way) {
                    int32_t& link = links[(size_t)way * size + p];
                    if (link <= 0)
                        continue;
                    const int to = p + steps[way];
                    if (above[to] + 1 != above[p]) {
                        least = std::min(above[to], least);
                        continue;
                    }
                    const int amount = surplus[p] < link ? (int)surplus[p] : link;
                    if (surplus[to] == 0) {
                        queue[at + count < size ? at + count : at + count - size] = to;
                        ++count;
                    }
                    link -= amount;
                    links[(size_t)(way ^ 1) * size + to] += amount;
                    surplus[p] -= amount;
                    surplus[to] += amount;
                    if (link > 0)
                        least = std::min(above[to], least);
                }
                if (surplus[p] > 0) {
                    above[p] = least + 1 < far ? least + 1 : far;
                    ++relabelled;
                }
            }
        }
    }
    for (int p = 0; p < size; ++p)
        visible[p] = free[p] && above[p] < far;
}

}  // namespace vig
