#include <algorithm>
#include <atomic>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
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
void run_workers(Loop& loop, int workers) {
  std::vector<std::thread> threads;
  for (int worker = 1; worker < workers; ++worker) {
    threads.emplace_back([&loop, worker] { loop.run_worker(worker); });
  }
  loop.run_worker(0);
  for (std::thread& thread : threads) thread.join();
}

#else

/// The arena is kept from loop to loop: a turntable runs thousands of short ones. It is made anew
/// when the number of threads changes; a loop that still runs in the old one keeps it alive.
std::shared_ptr<tbb::task_arena> arena(int threads) {
  static std::mutex mutex;
  static std::shared_ptr<tbb::task_arena> current;
  static std::unique_ptr<tbb::global_control> limit;
  static int current_threads = 0;
  const std::lock_guard lock(mutex);
  if (current_threads != threads) {
    // oneTBB caps its workers at the cores; set_thread_count() may ask for more.
    limit =
        std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                              static_cast<std::size_t>(std::max(threads, cores())));
    current = std::make_shared<tbb::task_arena>(threads);
    current_threads = threads;
  }
  return current;
}

void run_workers(Loop& loop, int workers) {
  arena(thread_count())->execute([&] {
    tbb::task_group group;
    for (int worker = 1; worker < workers; ++worker) {
      group.run([&loop, worker] { loop.run_worker(worker); });
    }
    loop.run_worker(0);
    group.wait();
  });
}

#endif

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
