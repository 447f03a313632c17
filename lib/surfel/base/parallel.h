#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <numeric>
#include <type_traits>
#include <utility>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/function_ref.h>

namespace surfel {

/// The most workers that a loop has, whatever is asked for: PerWorker has a place for each.
inline constexpr int kMostThreads = 1024;

/// Number of threads that parallel loops use, in [1, kMostThreads].
SURFEL_API int thread_count() noexcept;

/// Sets the number of threads for the whole process; 0 or less means one per core, more than
/// kMostThreads means kMostThreads. Loops that run keep their number; results never depend on it.
SURFEL_API void set_thread_count(int threads) noexcept;

/// Asks all parallel loops of the process to stop: running loops throw Error(kInterrupted) at the
/// next range, later ones at their first, until the request is withdrawn. Safe to call from a
/// signal handler.
SURFEL_API void request_interrupt() noexcept;
/// Takes the request back, so that loops run again.
SURFEL_API void withdraw_interrupt() noexcept;
SURFEL_API bool interrupt_requested() noexcept;

/// Calls body(begin, end, worker) for consecutive ranges of [0, count) of `grain` items each (the
/// last may be shorter). A range should take tens of microseconds, beside which handing it out
/// costs nothing: constants named k...Grain, and grains without a name, come from this rule. The
/// ranges depend on `count` and `grain` alone, never on the number of threads, so that a sum per
/// range, added up in the order of the ranges, is the same on every run. `worker` is in [0,
/// kMostThreads) and no two running calls of the loop share it: it picks scratch memory from a
/// PerWorker, never a place for results. An exception of the body stops the loop and is passed on
/// once all workers have stopped; if several ranges fail, the exception of the lowest range is. A
/// loop inside a loop's body runs on the calling thread alone, as worker 0. Several threads may run
/// loops at once.
SURFEL_API void parallel_for(
    std::size_t count, std::size_t grain,
    FunctionRef<void(std::size_t begin, std::size_t end, int worker)> body);

/// Calls body(i) for every i below `count`, in parallel: a range has `grain` of them. No result
/// depends on the grain.
template <class Body>
void parallel_each(std::size_t count, std::size_t grain, const Body& body) {
  parallel_for(count, grain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) body(i);
  });
}

/// Scratch memory for the workers of a loop, one T for each, made when the worker first asks for it
/// and kept for later loops. However many threads later loops have, there is a place for each of
/// their workers. One loop at a time may use it.
template <class T>
class PerWorker {
 public:
  /// Every T is made by its default constructor.
  PerWorker() requires std::is_default_constructible_v<T>
      : PerWorker([] { return std::make_unique<T>(); }) {}
  /// \param make  makes one worker's T; workers call it at once.
  explicit PerWorker(std::function<std::unique_ptr<T>()> make) : make_(std::move(make)) {}

  /// Scratch of the worker that calls.
  T& operator[](int worker) {
    std::unique_ptr<T>& place = places_[static_cast<std::size_t>(worker)];
    if (!place) place = make_();
    return *place;
  }
  /// Calls body(scratch) for every T that was made, in the order of the workers; not while a loop
  /// uses them.
  template <class Body>
  void for_each(Body&& body) {
    for (std::unique_ptr<T>& place : places_) {
      if (place) body(*place);
    }
  }

 private:
  std::function<std::unique_ptr<T>()> make_;
  std::array<std::unique_ptr<T>, kMostThreads> places_;
};

/// Number of indices i below `count` for which holds(i) is true; several threads call holds().
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
