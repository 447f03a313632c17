#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/estimate/block_pass.h>
#include <surfel/estimate/point_estimates.h>
#include <surfel/estimate/stored_sides.h>

namespace surfel {

/// Estimates of the points of a block, in the order of the file.
struct SurfelBlock {
  BlockPoints points;
  PointEstimates estimates;
  Array<std::uint8_t> turned;  ///< 1 where orientation turned the normal.
  std::size_t components = 0;
  Orientation method = Orientation::kNone;
};

/// The pass over the blocks of a cloud that makes surfels.
class SurfelPass {
 public:
  /// Keeps references to the cloud and to the sides that an earlier pass has found; null: none.
  SurfelPass(const BlockCloud& cloud, const StoredSides* sides);
  SurfelPass(const SurfelPass&) = delete;
  SurfelPass& operator=(const SurfelPass&) = delete;

  /// Whether splats are ellipses.
  void set_ellipses(bool ellipses) { ellipses_ = ellipses; }
  /// Estimates the points of some runs.
  SurfelBlock make(std::size_t begin_run, std::size_t end_run) const;
  /// The surfels of a block that has been estimated.
  static SurfelCloud surfels(SurfelBlock&& block);
  /// A surfel with all columns that the result has.
  SurfelCloud first_surfel() const;

 private:
  Array<Vec3f> directions(const SurfelCloud& piece, std::size_t run) const;
  HaloOptions halo() const;
  void make_room(SurfelBlock& block) const;
  void turn(const LoadedBlock& loaded, HaloNormals& found, Array<float>& confidence,
            SurfelBlock& block) const;
  HaloTask estimate(const LoadedBlock& loaded, SurfelBlock& block) const;

  const BlockCloud& cloud_;
  const StoredSides* sides_;
  BlockPass pass_;
  bool ellipses_ = false;
};

}  // namespace surfel
