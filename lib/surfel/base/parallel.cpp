#include <algorithm>
#include <atomic>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/memory.h>
#include <surfel/base/parallel.h>
#include <surfel/base/thread_limits.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

namespace surfel {
namespace {

std::atomic<int> g_thread_count{0};
std::atomic<bool> g_interrupt{false};
thread_local bool t_inside_loop = false;

/// Asked for once: the system opens and reads a file for each answer.
int cores() noexcept {
  static const int count = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  return count;
}

void throw_if_interrupted() {
  if (interrupt_requested()) throw Error(ErrorKind::kInterrupted, "interrupted");
}

/// One loop's shared state; workers take the next range until none is left or one has failed.
/// Ranges are taken in ascending order, so that every range below a failed one has been started:
/// the failure of the lowest is the one that a single thread would have met.
struct Loop {
  std::size_t count;
  std::size_t grain;
  FunctionRef<void(std::size_t, std::size_t, int)> body;
  std::atomic<std::size_t> next{0};
  std::atomic<bool> failed{false};
  std::exception_ptr error{};
  std::size_t error_begin = std::numeric_limits<std::size_t>::max();
  std::mutex error_mutex{};

  void run_worker(int worker) {
    const bool outer = t_inside_loop;
    t_inside_loop = true;
    while (!failed.load(std::memory_order_relaxed)) {
      const std::size_t begin = next.fetch_add(grain, std::memory_order_relaxed);
      if (begin >= count) break;
      try {
        throw_if_interrupted();
        body(begin, std::min(count, begin + grain), worker);
      } catch (...) {
        fail(begin);
      }
    }
    t_inside_loop = outer;
  }

  void fail(std::size_t begin) {
    const std::lock_guard lock(error_mutex);
    if (begin < error_begin) {
      error = std::current_exception();
      error_begin = begin;
    }
    failed.store(true, std::memory_order_relaxed);
  }
};

#ifdef SURFEL_TSAN
/// oneTBB's library is not instrumented, and the thread sanitizer would report its own accesses;
/// with plain threads it sees what matters, the bodies of the loops.
constexpr bool kOnlyPlainThreads = true;
#else
constexpr bool kOnlyPlainThreads = false;
#endif

/// Runs the loop on threads of its own, as many of them as the system starts.
void run_on_plain_threads(Loop& loop, int workers) {
  std::vector<std::thread> threads;
  try {
    threads.reserve(static_cast<std::size_t>(workers));
    for (int worker = 1; worker < workers; ++worker) {
      threads.emplace_back([&loop, worker] { loop.run_worker(worker); });
    }
  } catch (const std::exception&) {
    // No memory for a thread, or too many of them: the threads that run do the work.
  }
  loop.run_worker(0);
  for (std::thread& thread : threads) thread.join();
}

/// Who runs loops. oneTBB ends the process where one of its threads fails to start, which it does
/// when a loop first needs them: where the address space is limited (ulimit -v), or so many threads
/// cannot be started, loops have plain threads, and fewer of them where memory is short.
struct Crew {
  int threads = 0;  ///< That were asked for.
  int most = 1;     ///< Workers of a loop.
  /// Kept from loop to loop: a turntable runs thousands of short ones. Null: plain threads.
  std::shared_ptr<tbb::task_arena> arena;
};

Crew make_crew(int threads) {
  if (address_space_is_limited()) {
    // Address space of a thread: the stack, and what malloc() sets aside for it, in bytes.
    constexpr std::uint64_t kThreadSpace = std::uint64_t{256} << 20;
    const std::uint64_t more = available_memory_bytes() / kThreadSpace;
    return {threads, 1 + static_cast<int>(std::min<std::uint64_t>(more, kMostThreads)), nullptr};
  }
  static int proven = 1;  // So many threads have been there at once.
  if (kOnlyPlainThreads || (threads > proven && !can_start_threads(threads - 1))) {
    return {threads, threads, nullptr};
  }
  proven = std::max(proven, threads);
  return {threads, threads, std::make_shared<tbb::task_arena>(threads)};
}

/// The crew is made anew when the number of threads changes; a loop that still runs in the old one
/// keeps it alive.
Crew crew(int threads) {
  static std::mutex mutex;
  static Crew current;
  static std::unique_ptr<tbb::global_control> limit;
  const std::lock_guard lock(mutex);
  if (current.threads != threads) {
    current = make_crew(threads);
    // oneTBB caps its workers at the cores; set_thread_count() may ask for more.
    if (current.arena) {
      limit = std::make_unique<tbb::global_control>(
          tbb::global_control::max_allowed_parallelism,
          static_cast<std::size_t>(std::max(threads, cores())));
    }
  }
  return current;
}

void run_workers(Loop& loop, int workers) {
  const Crew with = crew(thread_count());
  workers = std::min(workers, with.most);
  if (!with.arena) {
    run_on_plain_threads(loop, workers);
    return;
  }
  with.arena->execute([&] {
    tbb::task_group group;
    for (int worker = 1; worker < workers; ++worker) {
      group.run([&loop, worker] { loop.run_worker(worker); });
    }
    loop.run_worker(0);
    group.wait();
  });
}

}  // namespace

SerialLoops::SerialLoops() noexcept : before_(std::exchange(t_inside_loop, true)) {}
SerialLoops::~SerialLoops() { t_inside_loop = before_; }

int thread_count() noexcept {
  const int set = g_thread_count.load(std::memory_order_relaxed);
  return std::min(set > 0 ? set : cores(), kMostThreads);
}

void set_thread_count(int threads) noexcept {
  g_thread_count.store(std::max(0, threads), std::memory_order_relaxed);
}

void request_interrupt() noexcept { g_interrupt.store(true, std::memory_order_relaxed); }

void withdraw_interrupt() noexcept { g_interrupt.store(false, std::memory_order_relaxed); }

bool interrupt_requested() noexcept { return g_interrupt.load(std::memory_order_relaxed); }

void parallel_for(std::size_t count, std::size_t grain,
                  FunctionRef<void(std::size_t, std::size_t, int)> body) {
  if (count == 0) return;
  grain = std::max<std::size_t>(1, grain);
  const std::size_t ranges = (count - 1) / grain + 1;
  const int threads =
      t_inside_loop ? 1 : static_cast<int>(std::min<std::size_t>(ranges, thread_count()));
  if (threads == 1) {
    const bool outer = t_inside_loop;
    for (std::size_t begin = 0; begin < count; begin += grain) {
      if (!outer) throw_if_interrupted();
      body(begin, std::min(count, begin + grain), 0);
    }
    return;
  }
  Loop loop{count, grain, body};
  run_workers(loop, threads);
  if (loop.error) std::rethrow_exception(loop.error);
}

}  // namespace surfel
