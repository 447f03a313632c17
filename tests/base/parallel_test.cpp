#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/random.h>

namespace surfel {
namespace {

/// The number of threads is the process's; each test leaves it as it was.
class ParallelFor : public testing::TestWithParam<int> {
 protected:
  void SetUp() override { set_thread_count(GetParam()); }
  void TearDown() override { set_thread_count(0); }
};

TEST_P(ParallelFor, CoversEveryIndexOnceInFixedRanges) {
  for (const std::size_t count : {0, 1, 2, 63, 64, 65, 1000, 12345}) {
    for (const std::size_t grain : {0, 1, 7, 64, 100000}) {
      const std::size_t step = std::max<std::size_t>(1, grain);
      std::vector<int> visits(count, 0);
      parallel_for(count, grain, [&](std::size_t begin, std::size_t end, int) {
        EXPECT_EQ(begin % step, 0);
        EXPECT_EQ(end, std::min(count, begin + step));
        for (std::size_t i = begin; i < end; ++i) ++visits[i];
      });
      EXPECT_EQ(visits, std::vector<int>(count, 1)) << count << " by " << grain;
    }
  }
}

TEST_P(ParallelFor, NoTwoRunningCallsShareAWorker) {
  std::vector<std::atomic<int>> running(static_cast<std::size_t>(GetParam()));
  std::atomic<bool> shared{false};
  parallel_for(20000, 1, [&](std::size_t, std::size_t, int worker) {
    ASSERT_GE(worker, 0);
    ASSERT_LT(worker, GetParam());
    if (running[worker].fetch_add(1) != 0) shared = true;
    running[worker].fetch_sub(1);
  });
  EXPECT_FALSE(shared);
}

TEST_P(ParallelFor, ScratchByWorkerNeedsNoLock) {
  // Plain memory, written by one worker at a time: a race here is what the thread sanitizer sees.
  PerWorker<std::vector<int>> scratch;
  for (int repeat = 0; repeat < 50; ++repeat) {
    parallel_for(1000, 10, [&](std::size_t begin, std::size_t, int worker) {
      scratch[worker].push_back(static_cast<int>(begin));
    });
  }
  std::size_t sum = 0;
  scratch.for_each([&](const std::vector<int>& s) { sum += s.size(); });
  EXPECT_EQ(sum, 50 * 100);
}

TEST_P(ParallelFor, SumPerRangeIsTheSameForAnyThreads) {
  const auto sum = [] {
    constexpr std::size_t kGrain = 1000;
    std::vector<double> partial(100);
    parallel_for(100 * kGrain, kGrain, [&](std::size_t begin, std::size_t end, int) {
      double s = 0;
      for (std::size_t i = begin; i < end; ++i) s += random_uniform(1, i);
      partial[begin / kGrain] = s;
    });
    double total = 0;
    for (const double s : partial) total += s;
    return total;
  };
  const double with_threads = sum();
  set_thread_count(1);
  EXPECT_EQ(with_threads, sum());
}

TEST_P(ParallelFor, PassesOnTheFailureOfTheLowestRange) {
  for (int repeat = 0; repeat < 20; ++repeat) {
    std::atomic<int> calls{0};
    try {
      parallel_for(10000, 10, [&](std::size_t begin, std::size_t, int) {
        ++calls;
        if (begin >= 300) throw std::runtime_error(std::to_string(begin));
      });
      FAIL() << "nothing was thrown";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "300");
    }
    EXPECT_LE(calls, 30 + GetParam());  // The loop stops: each worker fails at most once.
  }
}

TEST_P(ParallelFor, WorksAgainAfterAFailure) {
  EXPECT_THROW(parallel_for(100, 1, [](std::size_t, std::size_t, int) { throw_input("", "x"); }),
               Error);
  std::atomic<int> calls{0};
  parallel_for(100, 1, [&](std::size_t, std::size_t, int) { ++calls; });
  EXPECT_EQ(calls, 100);
}

TEST_P(ParallelFor, InnerLoopRunsOnTheCallersThread) {
  std::atomic<int> elsewhere{0};
  std::vector<int> visits(100 * 50, 0);
  parallel_for(100, 1, [&](std::size_t outer, std::size_t, int) {
    const auto thread = std::this_thread::get_id();
    parallel_for(50, 1, [&](std::size_t inner, std::size_t, int worker) {
      if (worker != 0 || std::this_thread::get_id() != thread) ++elsewhere;
      ++visits[outer * 50 + inner];
    });
  });
  EXPECT_EQ(elsewhere, 0);
  EXPECT_EQ(visits, std::vector<int>(100 * 50, 1));
}

TEST_P(ParallelFor, TwoCallersAtOnceEachGetTheirOwnLoop) {
  const auto count = [](std::vector<int>& visits) {
    for (int repeat = 0; repeat < 20; ++repeat) {
      parallel_for(visits.size(), 16, [&](std::size_t begin, std::size_t end, int) {
        for (std::size_t i = begin; i < end; ++i) ++visits[i];
      });
    }
  };
  std::vector<int> a(5000, 0);
  std::vector<int> b(5000, 0);
  std::thread other([&] { count(a); });
  count(b);
  other.join();
  EXPECT_EQ(a, std::vector<int>(5000, 20));
  EXPECT_EQ(b, std::vector<int>(5000, 20));
}

TEST(PerWorker, HasPlacesForWorkersOfLoopsWithMoreThreadsThanBefore) {
  set_thread_count(1);
  PerWorker<int> visits([] { return std::make_unique<int>(0); });
  for (const int threads : {1, 16, 2 * kMostThreads}) {
    set_thread_count(threads);
    parallel_for(500, 1, [&](std::size_t, std::size_t, int worker) { ++visits[worker]; });
  }
  int sum = 0;
  visits.for_each([&](int count) { sum += count; });
  EXPECT_EQ(sum, 1500);
}

TEST(PerWorker, ThreadCountMayChangeWhileALoopRuns) {
  set_thread_count(8);
  std::atomic<bool> stop{false};
  std::thread other([&] {
    for (int threads = 1; !stop; threads = threads % 32 + 1) set_thread_count(threads);
  });
  for (int repeat = 0; repeat < 200; ++repeat) {
    PerWorker<std::size_t> visits([] { return std::make_unique<std::size_t>(0); });
    parallel_for(200, 1, [&](std::size_t, std::size_t, int worker) { ++visits[worker]; });
    std::size_t sum = 0;
    visits.for_each([&](std::size_t count) { sum += count; });
    ASSERT_EQ(sum, 200U);
  }
  stop = true;
  other.join();
}

INSTANTIATE_TEST_SUITE_P(Threads, ParallelFor, testing::Values(1, 2, 5, 16));

TEST(ThreadCount, ZeroAndLessMeanOnePerCore) {
  set_thread_count(3);
  EXPECT_EQ(thread_count(), 3);
  set_thread_count(-1);
  const int automatic = thread_count();
  EXPECT_GE(automatic, 1);
  set_thread_count(0);
  EXPECT_EQ(thread_count(), automatic);
}

TEST(ThreadCount, HasALimit) {
  set_thread_count(kMostThreads + 1);
  EXPECT_EQ(thread_count(), kMostThreads);
}

TEST(Interrupt, StopsRunningLoopsWithAnError) {
  for (const int threads : {1, 4}) {
    set_thread_count(threads);
    std::atomic<int> calls{0};
    try {
      parallel_for(100000, 1, [&](std::size_t begin, std::size_t, int) {
        ++calls;
        if (begin == 10) request_interrupt();
        // The one who asks may have to wait for a core that the others would use up the loop on.
        while (begin > 10 && !interrupt_requested()) std::this_thread::yield();
      });
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInterrupted);
    }
    EXPECT_LT(calls, 1000);
    EXPECT_THROW(parallel_for(10, 1, [](std::size_t, std::size_t, int) {}), Error);
    withdraw_interrupt();
    calls = 0;
    parallel_for(10, 1, [&](std::size_t, std::size_t, int) { ++calls; });
    EXPECT_EQ(calls, 10);
  }
}

TEST(SerialLoops, KeepLoopsOnTheirThread) {
  set_thread_count(4);
  const auto self = std::this_thread::get_id();
  {
    const SerialLoops alone;
    std::atomic<int> strangers{0};
    for (int loop = 0; loop < 200; ++loop) {
      parallel_for(64, 1, [&](std::size_t, std::size_t, int worker) {
        if (worker != 0 || std::this_thread::get_id() != self) ++strangers;
        std::this_thread::yield();  // Another worker, were there one, would take the next range.
      });
    }
    EXPECT_EQ(strangers, 0);
  }
  // Afterwards another thread takes part: its caller stays in a range until it does.
  std::mutex mutex;
  std::condition_variable changed;
  bool stranger = false;
  bool given_up = false;
  parallel_for(64, 1, [&](std::size_t, std::size_t, int) {
    std::unique_lock lock(mutex);
    if (std::this_thread::get_id() != self) stranger = true;
    changed.notify_all();
    given_up = given_up || !changed.wait_for(lock, std::chrono::seconds(60),
                                             [&] { return stranger || given_up; });
  });
  EXPECT_TRUE(stranger);
  set_thread_count(0);
}

}  // namespace
}  // namespace surfel
