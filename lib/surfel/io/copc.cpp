// COPC specification 1.0, https://copc.io

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <set>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/copc.h>

namespace surfel {
namespace {

constexpr std::size_t kInfoBytes = 160;
constexpr std::int32_t kDeepest = 30;

/// A node of the tree, or a page with the nodes below it.
struct CopcEntry {
  static constexpr std::int32_t kPage = -1;

  std::int32_t level;
  std::array<std::int32_t, 3> place;  ///< Cells of the level from the lowest corner.
  std::uint64_t offset;
  std::int32_t bytes;
  std::int32_t points;
};
static_assert(sizeof(CopcEntry) == 32);

class CopcReader {
 public:
  CopcReader(const InputFile& file, const LasHeader& header, std::optional<int> level,
             const std::optional<Bounds>& bounds)
      : file_(file), header_(header), level_(level.value_or(kDeepest)), bounds_(bounds) {}

  CopcPart read() {
    if (!header_.copc || !header_.compressed) {
      throw_input(file_.name(), "is no COPC file, whose points have levels; leave out `level`");
    }
    if (header_.copc->size() < kInfoBytes) damaged("has no whole description");
    const auto number = [&]<class T>(std::size_t at, T value) {
      std::memcpy(&value, header_.copc->data() + at, sizeof(T));
      return value;
    };
    for (std::size_t k = 0; k < 3; ++k) {
      center_[static_cast<Eigen::Index>(k)] = number(8 * k, double{});
    }
    half_ = number(24, double{});
    if (!center_.allFinite() || !(half_ > 0) || !std::isfinite(half_)) {
      damaged("has a cube that is not finite");
    }
    read_page(number(40, std::uint64_t{}), number(48, std::uint64_t{}));
    while (!pages_.empty()) {
      const auto [offset, bytes] = pages_.back();
      pages_.pop_back();
      read_page(offset, bytes);
    }
    return in_order();
  }

 private:
  [[noreturn]] void damaged(const char* what) const {
    throw_input(file_.name(),
                fmt::format("its COPC tree {}; the file is truncated or damaged", what));
  }

  /// May the part have points of this node, or of nodes below it?
  bool wanted(const CopcEntry& entry) const {
    if (entry.level > level_) return false;
    if (!bounds_) return true;
    const double side = std::ldexp(2 * half_, -entry.level);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto axis = static_cast<Eigen::Index>(k);
      const double low = center_[axis] - half_ + side * entry.place[k];
      if (low > bounds_->max[axis] || low + side < bounds_->min[axis]) return false;
    }
    return true;
  }

  void read_page(std::uint64_t offset, std::uint64_t bytes) {
    // Pages share no bytes, so that they are not more than the file.
    page_bytes_ += std::min<std::uint64_t>(bytes, file_.size());
    if (offset > file_.size() || bytes > file_.size() - offset || page_bytes_ > file_.size() ||
        !seen_.insert(offset).second) {
      damaged("has pages that are not in the file");
    }
    Array<std::byte> scratch;
    std::vector<CopcEntry> entries(bytes / sizeof(CopcEntry));
    if (entries.empty()) return;
    std::memcpy(entries.data(), file_.read_at(offset, bytes, scratch),
                entries.size() * sizeof(CopcEntry));
    for (const CopcEntry& entry : entries) {
      if (entry.level < 0 || entry.level > kDeepest || entry.bytes < 0 ||
          entry.points < CopcEntry::kPage) {
        damaged("has an impossible node");
      }
      if (!wanted(entry)) continue;
      if (entry.points == CopcEntry::kPage) {
        pages_.emplace_back(entry.offset, static_cast<std::uint64_t>(entry.bytes));
      } else if (entry.points > 0) {
        nodes_.push_back(entry);
      }
    }
  }

  CopcPart in_order() {
    std::sort(nodes_.begin(), nodes_.end(),
              [](const CopcEntry& a, const CopcEntry& b) { return a.offset < b.offset; });
    CopcPart part;
    std::uint64_t end = 0;
    for (const CopcEntry& node : nodes_) {
      const auto points = static_cast<std::uint64_t>(node.points);
      const LazChunk chunk{node.offset, static_cast<std::uint64_t>(node.bytes), part.count};
      if (chunk.begin < end) damaged("has nodes that share their points");
      check_laz_chunk(file_, header_, chunk, points);
      end = chunk.begin + chunk.bytes;
      part.chunks.push_back(chunk);
      part.count += points;
    }
    if (part.count > header_.count) damaged("has more points than the header counts");
    return part;
  }

  const InputFile& file_;
  const LasHeader& header_;
  int level_;
  const std::optional<Bounds>& bounds_;
  Vec3d center_;
  double half_ = 0;
  std::set<std::uint64_t> seen_;
  std::uint64_t page_bytes_ = 0;
  std::vector<std::pair<std::uint64_t, std::uint64_t>> pages_;  ///< Yet to be read.
  std::vector<CopcEntry> nodes_;
};

}  // namespace

CopcPart copc_part(const InputFile& file, const LasHeader& header, std::optional<int> level,
                   const std::optional<Bounds>& bounds) {
  return CopcReader(file, header, level, bounds).read();
}

}  // namespace surfel
