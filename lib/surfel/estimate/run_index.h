#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <surfel/base/box_tree.h>
#include <surfel/base/export.h>
#include <surfel/base/morton.h>
#include <surfel/base/types.h>
#include <surfel/scene/surfel_ranges.h>

namespace surfel {

/// A box along the axes, which a cloud's places bound.
struct RunBox {
  Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
  Vec3f high = Vec3f::Constant(-std::numeric_limits<float>::infinity());

  void add(const Vec3f& place) {
    low = low.cwiseMin(place);
    high = high.cwiseMax(place);
  }
  void add(const RunBox& other) {
    low = low.cwiseMin(other.low);
    high = high.cwiseMax(other.high);
  }
  /// Square of the distance between the nearest points of two boxes; infinite where one is empty.
  float distance2(const RunBox& other) const {
    return (low - other.high).cwiseMax(other.low - high).cwiseMax(0.0F).squaredNorm();
  }
  float distance2(const Vec3f& place) const {
    return (low - place).cwiseMax(place - high).cwiseMax(0.0F).squaredNorm();
  }
};

/// Runs of consecutive points of a cloud, with their boxes: what is kept in memory of points that
/// are not. 38 bytes a run.
class SURFEL_API RunIndex {
 public:
  /// Points of a run; only the cloud's last one has fewer.
  explicit RunIndex(std::size_t length) : length_(length) {}

  /// Bytes that a run takes.
  static constexpr std::size_t kRunBytes = 38;

  struct Run {
    RunBox box;                ///< Of the finite points.
    std::uint32_t finite = 0;  ///< How many points are finite.
  };
  using Tree = BoxTree<RunBox, 16, 8>;

  /// Adds the next runs of the cloud: all points of a piece.
  void add(const Array<Vec3f>& piece);
  /// Makes the tree, once all points have been added.
  void finish();

  std::size_t length() const { return length_; }
  std::size_t size() const { return runs_.size(); }
  std::size_t points() const { return points_; }
  std::size_t finite() const { return finite_; }
  /// How many runs have boxes that meet the box of one of them, itself included: the median of
  /// some.
  std::size_t median_meeting() const;
  const Run& operator[](std::size_t run) const { return runs_[run]; }
  /// Number of a run's first point among the finite points of the cloud; called after finish().
  std::uint64_t finite_before(std::size_t run) const { return finite_before_[run]; }
  /// The boxes of the runs, for searches; empty before finish().
  const Tree& tree() const { return tree_; }
  /// First point of a run, or the end of the last one.
  std::size_t begin(std::size_t run) const { return std::min(run * length_, points_); }

 private:
  std::size_t length_;
  std::size_t points_ = 0;
  std::size_t finite_ = 0;
  std::vector<Run> runs_;
  std::vector<std::uint64_t> finite_before_;
  Tree tree_;
};

/// The exact search for the points of a cloud that is not in memory, by its runs: for single
/// queries, as a query reads some runs. The runs read last are kept, 256 of them.
class SURFEL_API RunSearch {
 public:
  RunSearch(const SurfelRanges& cloud, const RunIndex& index)
      : cloud_(cloud), index_(index), grid_(cloud.grid()) {}

  /// Finds the k points nearest to a place, as NearestPlaces (place_sample.h) does.
  void nearest(const Vec3f& place, std::size_t k, std::vector<Vec3f>& out);

  /// Finds directions as NearestDirections (range_normals.h) does.
  void nearest_directions(const Vec3d& sensor, const Vec3f& direction, std::size_t k,
                          std::vector<float>& distance2);

 private:
  struct Found {
    float distance2;
    std::uint64_t code;
    std::size_t index;
    Vec3f position;
  };
  static bool before(const Found& a, const Found& b);
  struct Kept {
    std::size_t run;
    Array<Vec3f> position;
  };
  const Array<Vec3f>& read(std::size_t run);

  const SurfelRanges& cloud_;
  const RunIndex& index_;
  MortonGrid grid_;
  std::vector<Kept> kept_;
  std::size_t next_ = 0;  ///< The one of kept_ that is read over next.
};

}  // namespace surfel
