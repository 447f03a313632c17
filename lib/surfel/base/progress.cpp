#include <algorithm>

#include <surfel/base/progress.h>

namespace surfel {
namespace {

std::atomic<ProgressObserver*> g_observer{nullptr};

}  // namespace

ProgressStage::ProgressStage(std::string name, std::uint64_t total, std::string unit)
    : name_(std::move(name)), unit_(std::move(unit)), total_(total) {
  if (ProgressObserver* const observer = g_observer.load()) observer->begin(*this);
}

ProgressStage::~ProgressStage() {
  if (ProgressObserver* const observer = g_observer.load()) observer->end(*this);
}

void ProgressStage::set_share(double share) noexcept {
  const double done = std::clamp(share, 0.0, 1.0) * static_cast<double>(total_);
  done_.store(static_cast<std::uint64_t>(done), std::memory_order_relaxed);
}

void set_progress_observer(ProgressObserver* observer) noexcept { g_observer.store(observer); }

}  // namespace surfel
