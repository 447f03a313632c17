#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include <surfel/base/checkpoints.h>
#include <surfel/scene/surfel_sink.h>

namespace surfel::test {

/// Stands for the end of a run that is killed.
struct Killed {};

/// The file of a work in blocks, whose runs are killed after each part that they finish.
class InterruptedWork final : public SurfelSink, public Checkpoints {
 public:
  /// Calls run() until it is not killed. \return how many runs that took.
  template <class Run>
  int complete(const Run& run) {
    for (int runs = 1;; ++runs) {
      begun_ = false;
      try {
        run();
        return runs;
      } catch (const Killed&) {
      }
    }
  }
  /// By the number of their first surfels.
  const std::map<std::size_t, SurfelCloud>& blocks() const { return blocks_; }

  void begin(const SurfelCloud& /*like*/, std::size_t /*count*/) override {
    // What earlier runs have left is taken up once.
    if (begun_) {
      std::erase_if(parts_, [](const auto& part) { return part.second.with_rows; });
    }
    begun_ = true;
  }
  void put(SurfelCloud surfels, std::size_t at) override {
    blocks_.insert_or_assign(at, std::move(surfels));
  }
  std::optional<std::string> finished(std::uint64_t part) override {
    const auto found = parts_.find(part);
    if (found == parts_.end() || (found->second.with_rows && !begun_)) return std::nullopt;
    return found->second.state;
  }
  void finish(std::uint64_t part, std::span<const RowSpan> rows,
              const std::string& state) override {
    parts_.insert_or_assign(part, Part{!rows.empty(), state});
    throw Killed{};
  }

 private:
  struct Part {
    bool with_rows;
    std::string state;
  };
  bool begun_ = false;
  std::map<std::uint64_t, Part> parts_;
  std::map<std::size_t, SurfelCloud> blocks_;
};

}  // namespace surfel::test
