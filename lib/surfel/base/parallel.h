#pragma once

#include <cstddef>
#include <numeric>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>

namespace surfel {

/// Number of threads that parallel loops use; at least 1.
SURFEL_API int thread_count() noexcept;

/// Sets it for the whole process; 0 or less means one per core. Results never depend on it.
SURFEL_API void set_thread_count(int threads) noexcept;

/// Asks running parallel loops to stop: they throw Error(kInterrupted) at the next chunk. Safe to
/// call from a signal handler.
SURFEL_API void request_interrupt() noexcept;
SURFEL_API bool interrupt_requested() noexcept;

/// Calls body(begin, end, worker) for consecutive ranges of [0, count) of `grain` items each (the
/// last may be shorter). The ranges depend on `count` and `grain` alone, never on the number of
/// threads, so that a sum per range, added up in the order of the ranges, is the same on every run.
/// `worker` is in [0, thread_count()) and no two running calls share it: index scratch memory by
/// it, not results. An exception of the body stops the loop and is passed on once all workers have
/// stopped; of several, that of the lowest range. A loop inside a loop's body runs on the calling
/// thread alone, as worker 0.
SURFEL_API void parallel_for(
    std::size_t count, std::size_t grain,
    FunctionRef<void(std::size_t begin, std::size_t end, int worker)> body);

/// How many of the numbers below `count` there are that holds(i) says yes to, asked in parallel.
template <class Holds>
std::size_t count_where(std::size_t count, const Holds& holds) {
  constexpr std::size_t kGrain = 1024;
  std::vector<std::size_t> found((count + kGrain - 1) / kGrain);
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) found[begin / kGrain] += holds(i) ? 1 : 0;
  });
  return std::accumulate(found.begin(), found.end(), std::size_t{0});
}

/// While it lives, parallel loops on this thread run on it alone: for work beside a loop that has
/// the cores. Results are the same.
class SURFEL_API SerialLoops {
 public:
  SerialLoops() noexcept;
  ~SerialLoops();
  SerialLoops(const SerialLoops&) = delete;
  SerialLoops& operator=(const SerialLoops&) = delete;

 private:
  bool before_;
};

}  // namespace surfel
