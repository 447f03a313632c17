#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/morton.h>
#include <surfel/base/types.h>
#include <surfel/estimate/loaded_runs.h>
#include <surfel/estimate/run_index.h>
#include <surfel/scene/surfel_cloud.h>
#include <surfel/scene/surfel_ranges.h>

namespace surfel {

/// Stands for the number of a point that lies in no block.
inline constexpr std::uint32_t kHalo = std::numeric_limits<std::uint32_t>::max();

/// Points that are in memory for one pass, along the curve of the whole cloud.
struct HaloPoints {
  Array<Vec3f> position;
  Array<float> known;          ///< As HaloSearch has it.
  Array<Vec3f> previous;       ///< Directions for orient_normals(); empty where it needs none.
  Array<std::uint32_t> point;  ///< Number among the block's points, or kHalo.

  std::size_t size() const { return position.size(); }
  void append(const HaloPoints& more) {
    position.insert(position.end(), more.position.begin(), more.position.end());
    known.insert(known.end(), more.known.begin(), more.known.end());
    previous.insert(previous.end(), more.previous.begin(), more.previous.end());
    point.insert(point.end(), more.point.begin(), more.point.end());
  }
};

/// A box of points, and how wide the halo around it should be.
struct HaloRegion {
  RunBox box;
  float reach = 0;
};

/// The points of a block of consecutive runs, in the order of the file.
struct BlockPoints {
  std::size_t begin_run = 0, end_run = 0;
  std::vector<std::size_t> run_points;  ///< First finite point of each run, and the end.
  SurfelCloud cloud;                    ///< The finite points with all columns.
  Array<Vec3f> previous;                ///< As HaloPoints has it.
  Array<float> reach;                   ///< Width of the halo around each point.
};

/// Points of a block that are estimated in one pass, along the curve, and regions that earlier
/// passes found to be needed.
struct HaloTask {
  Array<std::uint32_t> points;
  std::vector<HaloRegion> needed;
};

struct HaloOptions {
  int neighbors = 16;           ///< Of the neighbourhoods of normals; 0: those have a radius.
  double radius = 0;            ///< Of these neighbourhoods, scene units.
  std::size_t most_points = 0;  ///< Points that the memory holds.
  /// The directions that orient_normals() or turn_to_sides() needs of all points from a run on;
  /// empty where they need none.
  std::function<Array<Vec3f>(const SurfelCloud& points, std::size_t run)> directions = {};
};

/// Loads points of a cloud that is not in memory with a halo: the runs of points around them.
class HaloLoader {
 public:
  /// Keeps references to the cloud, its index and the name.
  HaloLoader(const SurfelRanges& cloud, const RunIndex& index, HaloOptions options,
             const std::string& name);

  /// Finds how wide the halo around each point of a block should be, by the spacing that the points
  /// of a box have on a surface or on a line.
  /// \param points  of the block, along the curve
  void measure_reach(std::span<const std::uint32_t> points, BlockPoints& block) const;
  /// Loads the points of the task with their halo; none if there are more than the memory holds and
  /// the task has several points. Throws Error(kInput) where halos are most of the cloud.
  std::optional<HaloPoints> load(const HaloTask& task, const BlockPoints& block) const;

 private:
  template <class Body>
  void cut(std::span<const std::uint32_t> points, const BlockPoints& block, const Body& body) const;
  LoadedRuns wanted_runs(const HaloTask& task, const BlockPoints& block) const;
  HaloPoints read(std::size_t begin_run, std::size_t end_run, const BlockPoints& block) const;

  const SurfelRanges& cloud_;
  const RunIndex& index_;
  HaloOptions options_;
  const std::string& name_;
  MortonGrid grid_;
};

/// Throws Error(kInput) for a cloud whose consecutive points do not lie close together.
[[noreturn]] void refuse_disorder(const std::string& name);

}  // namespace surfel
