#include <algorithm>
#include <bit>
#include <cstdint>
#include <numeric>

#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/scene/curve_blocks.h>

namespace surfel {
namespace {

/// Surfels read at a time by one thread.
constexpr std::size_t kPiece = std::size_t{1} << 14;
/// Pieces that are held at a time, for the threads to share.
constexpr std::size_t kPieces = 8;

/// A surfel that can be drawn.
struct CurvePoint {
  std::uint64_t code;
  std::size_t index;  ///< In the cloud.
  Vec3f position;
};

bool may_follow(const CurvePoint& next, const CurvePoint& here) {
  return here.code != next.code ? here.code < next.code
                                : !before_on_curve(next.position, here.position);
}

/// How large the cells are whose border lies between two points along the curve.
int step_between(const CurvePoint& here, const CurvePoint& next) {
  // Cells of the grid are larger than all that is told apart within one of them.
  constexpr int kCells = 1 << 16;
  if (here.code == next.code) return step_on_curve(here.position, next.position);
  return kCells + static_cast<int>(std::bit_width(here.code ^ next.code));
}

struct Piece {
  std::vector<CurvePoint> points;
  UnusableSurfels dropped;
  bool in_order = true;
};

void read_piece(const SurfelRanges& ranges, const MortonGrid& grid, std::size_t begin,
                std::size_t end, Piece& piece) {
  const SurfelCloud cloud = ranges.read(begin, end);
  Array<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0U);
  piece.dropped = remove_unusable(cloud, false, order);
  piece.points.clear();
  for (const std::uint32_t i : order) {
    const Vec3f& position = cloud.position[i];
    piece.points.push_back({grid.code(position), begin + i, position});
  }
  piece.in_order = std::adjacent_find(piece.points.begin(), piece.points.end(),
                                      [](const CurvePoint& here, const CurvePoint& next) {
                                        return !may_follow(next, here);
                                      }) == piece.points.end();
}

/// Takes points along the curve, and cuts blocks off as soon as there are points enough.
class Cutter {
 public:
  explicit Cutter(std::size_t most) : most_(most) {}

  /// False if the points are not along the curve.
  bool add(const std::vector<CurvePoint>& points) {
    if (points.empty()) return true;
    if (!waiting_.empty() && !may_follow(points.front(), waiting_.back())) return false;
    waiting_.insert(waiting_.end(), points.begin(), points.end());
    std::size_t begin = 0;
    while (waiting_.size() - begin > most_) begin += cut(begin);
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(begin));
    return true;
  }
  /// The last block ends with the cloud.
  std::vector<CurveBlock> finish(std::size_t size) {
    if (!waiting_.empty()) emit(0, waiting_.size());
    if (!blocks_.empty()) blocks_.back().end = size;
    return std::move(blocks_);
  }

 private:
  /// Cuts off the first block of the waiting points from `begin` on; returns its size.
  std::size_t cut(std::size_t begin) {
    std::size_t best = most_;
    int highest = -1;
    for (std::size_t size = most_; size >= std::max<std::size_t>(1, most_ / 4); --size) {
      const CurvePoint* const next = waiting_.data() + begin + size;
      const int entered = step_between(next[-1], *next);
      if (entered > highest) {
        highest = entered;
        best = size;
      }
    }
    emit(begin, best);
    blocks_.back().end = waiting_[begin + best].index;
    return best;
  }
  void emit(std::size_t begin, std::size_t size) {
    CurveBlock block;
    block.begin = blocks_.empty() ? 0 : blocks_.back().end;
    block.count = static_cast<std::uint32_t>(size);
    block.min = block.max = waiting_[begin].position;
    for (std::size_t i = begin; i < begin + size; ++i) {
      block.min = block.min.cwiseMin(waiting_[i].position);
      block.max = block.max.cwiseMax(waiting_[i].position);
    }
    blocks_.push_back(block);
  }

  std::size_t most_;
  std::vector<CurvePoint> waiting_;
  std::vector<CurveBlock> blocks_;
};

}  // namespace

CurveBlocks curve_blocks(const SurfelRanges& ranges, std::size_t most) {
  CurveBlocks out;
  const MortonGrid grid = ranges.grid();
  const std::size_t size = ranges.size();
  Cutter cutter(most);
  std::vector<Piece> pieces(kPieces);
  ProgressStage stage("cutting blocks", size, "surfels");
  for (std::size_t first = 0; first < size; first += kPieces * kPiece) {
    const std::size_t last = std::min(size, first + kPieces * kPiece);
    parallel_for(last - first, kPiece, [&](std::size_t begin, std::size_t end, int) {
      read_piece(ranges, grid, first + begin, first + end, pieces[begin / kPiece]);
      stage.add(end - begin);
    });
    for (std::size_t k = 0; k * kPiece < last - first; ++k) {
      if (!pieces[k].in_order || !cutter.add(pieces[k].points)) {
        out.in_order = false;
        return out;
      }
      out.dropped.add(pieces[k].dropped);
    }
  }
  out.blocks = cutter.finish(size);
  return out;
}

}  // namespace surfel
