#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include <surfel/base/thread_limits.h>
#include <sys/resource.h>

namespace surfel {

bool can_start_threads(int count) noexcept {
  std::vector<std::thread> threads;
  std::mutex mutex;
  bool all = true;
  try {
    const std::lock_guard hold(mutex);
    threads.reserve(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) {
      threads.emplace_back([&mutex] { const std::lock_guard wait(mutex); });
    }
  } catch (const std::exception&) {
    all = false;
  }
  for (std::thread& thread : threads) thread.join();
  return all;
}

bool address_space_is_limited() noexcept {
  rlimit limit{};
  return getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY;
}

}  // namespace surfel
