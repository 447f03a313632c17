#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// Rows of a result, by their numbers.
struct RowSpan {
  std::uint64_t begin = 0;
  std::uint64_t end = 0;
};

/// Keeps the parts of a long work that are finished, so that the work can be taken up where it was
/// interrupted. Parts are numbered as the work likes, but by the same numbers in every run. A part
/// without rows is something that the work has found out.
class SURFEL_API Checkpoints {
 public:
  Checkpoints() = default;
  virtual ~Checkpoints() = default;
  Checkpoints(const Checkpoints&) = delete;
  Checkpoints& operator=(const Checkpoints&) = delete;

  /// The state that an earlier run kept with a part, whose rows are all there; none if the part is
  /// to be made. A state is handed out once.
  virtual std::optional<std::string> finished(std::uint64_t part) = 0;
  /// Keeps a part: the rows that it wrote, and what the work has to know of it. Callable from
  /// several threads at once.
  virtual void finish(std::uint64_t part, std::span<const RowSpan> rows,
                      const std::string& state) = 0;
};

}  // namespace surfel
