// Work shared out to as many threads as the caller asks for.
#pragma once
#include <algorithm>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace vig {

// Call run(thread) for thread 0 to `threads` - 1, side by side; the first error is thrown again.
template <class F> void run_threads(int threads, F&& run) {
    if (threads <= 1) {
        run(0);
        return;
    }
    std::exception_ptr error;
    std::mutex lock;
    const auto guarded = [&](int thread) {
        try {
            run(thread);
        } catch (...) {
            const std::lock_guard<std::mutex> held(lock);
            if (!error)
                error = std::current_exception();
        }
    };
    std::vector<std::thread> others;
    for (int thread = 1; thread < threads; ++thread)
        others.emplace_back(guarded, thread);
    guarded(0);
    for (std::thread& other : others)
        other.join();
    if (error)
        std::rethrow_exception(error);
}

}  // namespace vig
