#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <utility>

#include <surfel/base/export.h>

namespace surfel {

/// A stage of long work, which counts what is done of it. It begins where it is made and ends with
/// its scope, also by an exception. Counting costs one relaxed addition, and nothing depends on it:
/// loops count ranges of thousands of points, from any thread.
///
///     ProgressStage stage("normals", points.size(), "points");
///     parallel_for(points.size(), kGrain, [&](std::size_t begin, std::size_t end, int) {
///       ...
///       stage.add(end - begin);
///     });
class SURFEL_API ProgressStage {
 public:
  /// \param name   what is done, such as "estimating normals".
  /// \param total  how much there is to do, in units.
  /// \param unit   what is counted, such as "points"; "B" for bytes.
  ProgressStage(std::string name, std::uint64_t total, std::string unit);
  ~ProgressStage();
  ProgressStage(const ProgressStage&) = delete;
  ProgressStage& operator=(const ProgressStage&) = delete;

  void add(std::uint64_t more) noexcept { done_.fetch_add(more, std::memory_order_relaxed); }
  /// For work that tells the share of it that is done, 0..1.
  void set_share(double share) noexcept;

  const std::string& name() const { return name_; }
  const std::string& unit() const { return unit_; }
  std::uint64_t total() const { return total_; }
  std::uint64_t done() const noexcept { return done_.load(std::memory_order_relaxed); }

 private:
  std::string name_;
  std::string unit_;
  std::uint64_t total_;
  std::atomic<std::uint64_t> done_{0};
};

/// Is told of the stages that work goes through; it may read a stage's counts at any time between
/// its begin and its end. Stages may lie within one another and run on several threads at once, so
/// that both functions are called from any thread.
class SURFEL_API ProgressObserver {
 public:
  virtual ~ProgressObserver() = default;
  virtual void begin(const ProgressStage& stage) = 0;
  /// The stage is gone afterwards.
  virtual void end(const ProgressStage& stage) noexcept = 0;
};

/// Sets the observer of all work of this process, null for none (the default), not while work is
/// under way. It is the process's, as its threads and interruptions are, and not an option of every
/// function, because no result depends on it.
SURFEL_API void set_progress_observer(ProgressObserver* observer) noexcept;

}  // namespace surfel
