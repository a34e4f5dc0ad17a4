// Work shared out to as many threads as the caller asks for.
#pragma once
#include <algorithm>
#include <atomic>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace vig {

// Scratch memory that is lent to a call and kept for the next.
template <class T> class Lent {
  public:
    Lent() {
        const std::lock_guard<std::mutex> held(pool().lock);
        auto& free = pool().free;
        held_ = free.empty() ? std::make_unique<T>() : std::move(free.back());
        if (!free.empty())
            free.pop_back();
    }
    ~Lent() {
        const std::lock_guard<std::mutex> held(pool().lock);
        if (pool().free.size() < 8)
            pool().free.push_back(std::move(held_));
    }
    T& operator*() const { return *held_; }
    T* operator->() const { return held_.get(); }

  private:
    struct Pool {
        std::mutex lock;
        std::vector<std::unique_ptr<T>> free;
    };
    static Pool& pool() {
        static Pool one;
        return one;
    }
    std::unique_ptr<T> held_;
};

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
    int started = 1;
    try {
        others.reserve(threads - 1);
        for (; started < threads; ++started)
            others.emplace_back(guarded, started);
    } catch (const std::exception&) {  // a limit of memory or threads: the caller does the work of the missing ones
    }
    guarded(0);
    for (; started < threads; ++started)
        guarded(started);
    for (std::thread& other : others)
        other.join();
    if (error)
        std::rethrow_exception(error);
}

// So many threads that each has some 8,000 items: starting one takes as long as thousands.
inline int threads_for(size_t items, int most) { return (int)std::min<size_t>(std::max(most, 1), 1 + items / 8192); }

// Call run(number) for 0 to `count` - 1, shared out to at most `threads` threads.
template <class F> void share_out(size_t count, int threads, F&& run) {
    std::atomic<size_t> next{0};
    run_threads((int)std::min<size_t>(std::max(threads, 1), std::max<size_t>(count, 1)), [&](int) {
        for (size_t number; (number = next++) < count;)
            run(number);
    });
}

}  // namespace vig
