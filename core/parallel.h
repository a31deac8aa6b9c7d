// Threads for loops over pixels, images and lights.
#pragma once

#include <cstddef>
#include <functional>

namespace lightstage::core {

// The number of threads loops use: set_thread_count(), else $LIGHTSTAGE_THREADS, else the processors this
// process may run on (its affinity mask, not the machine's total). At least 1.
int thread_count();
// n <= 0 goes back to the default.
void set_thread_count(int n);

// Calls body(first, last) for disjoint ranges that cover [0, count), each at most `grain` long, on
// thread_count() threads. The ranges do not depend on the thread count, so results that are combined by range
// are reproducible. The first exception thrown by a body is rethrown here after all have ended. May be
// nested.
void parallel_for(std::size_t count, std::size_t grain,
                  const std::function<void(std::size_t first, std::size_t last)>& body);

}  // namespace lightstage::core
