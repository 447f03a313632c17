#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <surfel/base/peers.h>
#include <surfel/base/scratch_file.h>
#include <surfel/base/types.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/estimate/run_index.h>
#include <surfel/estimate/winding_tiles.h>

namespace surfel {

/// Sides by the winding number (winding_tiles.h) of a cloud that is not in memory: one pass over
/// its points finds them, and a later pass asks for them. Between the passes normals and sheets
/// wait on a scratch file, 16 bytes a point.
class StoredSides {
 public:
  /// \param index   of the cloud; a reference is kept.
  /// \param sample  places of the cloud, kWindingSample or fewer of which are looked at.
  /// \param beside  file on whose disk the scratch file is. Throws Error(kIo) where that has no
  ///                room.
  StoredSides(const RunIndex& index, std::size_t tile_points, std::span<const Vec3f> sample,
              const NearestPlaces& nearest, const std::string& beside);

  /// Bytes of memory that are taken besides the index.
  static std::uint64_t bytes(std::size_t points, std::size_t tile_points);

  /// Adds the next finite points of the cloud, with their normals (zero = unknown).
  void add(const Array<Vec3f>& position, const Array<Vec3f>& normal);
  /// Finds the sides. To be called once, after the last point.
  void finish();

  /// Tells the other processes what the first one has found: each has the same points, though those
  /// that are told have added none of them.
  void share(Peers& peers);

  std::size_t parts() const { return tiles_.sides().part.size(); }
  /// Sides of the points from the beginning of a run on, see WindingTiles::side(); zero of points
  /// that are not finite. Callable from several threads at once.
  Array<Vec3f> of(const Array<Vec3f>& position, std::size_t run) const;

 private:
  struct Point {
    Vec3f normal;  ///< On the side that its sheet's points have.
    std::uint32_t sheet;
  };
  void cut_tile();

  const RunIndex& index_;
  std::size_t tile_points_;
  WindingTiles tiles_;
  ScratchFile points_;              ///< A Point of each finite point.
  Array<Vec3f> position_, normal_;  ///< The points of the tile that has come so far.
};

}  // namespace surfel
