#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/image.h>
#include <surfel/scene/scene.h>

namespace surfel {

/// Light from all directions, filtered on the sphere for lookups of any width.
///
/// Widths are variances of directions along one axis, radians^2: the variance of Brownian motion on
/// the sphere, whose mean cosine is exp(-variance), so that variances of filters that follow one
/// another add up however wide they are. Level 0 is the picture. Each further level has half as
/// many rows, down to 32, and at least the standard deviation of 3/2 of their distance, made from
/// the level before it with the von Mises-Fisher lobe that has the missing mean cosine. Rows have
/// texels in proportion to their circumference, and the poles are texels of their own: nothing is
/// singular there, and there is no seam at the picture's border. Sums are weighted by solid angle,
/// and every level has the mean of the picture over the sphere.
///
/// The axes are defined in scene/lat_long.h. Memory: 14.6 bytes for each pixel of the picture (1024
/// x 512: 7.6 MB), while it is made also the picture's own 16.
class SURFEL_API EnvironmentMap {
 public:
  /// \param image  R G B A, of which A plays no role; twice as wide as high, at most 2^27 pixels.
  /// \param name   for messages.
  ///
  /// Throws Error(kInput) for other sizes and for values that are not finite. The same for any
  /// number of threads.
  EnvironmentMap(const Image& image, const std::string& name);

  /// Radiance from a direction, of a length as lat_long_place() takes it, filtered with `variance`
  /// >= 0, interpolated between the two levels next to it, so that the variance of the whole is
  /// right.
  Vec3f radiance(const Vec3f& direction, float variance) const;

  int levels() const { return static_cast<int>(levels_.size()); }
  /// The variance of level l's filter; 0 for the first.
  float variance(int level) const { return levels_[static_cast<std::size_t>(level)].variance; }
  /// Mean over the sphere of level l.
  Vec3d mean(int level) const { return mean(levels_[static_cast<std::size_t>(level)]); }
  std::uint64_t memory_bytes() const;

 private:
  /// Texels of one latitude, from longitude +pi on; texel i of n has its centre at u = (i + 1/2) /
  /// n.
  struct Ring {
    std::size_t begin = 0;
    int count = 1;
  };
  /// Ring 0 is the pole +y, a single texel, ring rows + 1 the other one; ring k between them has
  /// the colatitude (k - 1/2) pi / rows.
  struct Level {
    int rows = 1;
    float variance = 0;
    std::vector<Ring> rings{};
    Array<Vec3f> texels{};

    void add_ring(int count);
    double colatitude(int ring) const;
    /// Solid angle of each texel of a ring; the poles' texels have none: they are there to
    /// interpolate from.
    double solid_angle(int ring) const;
  };

  static Level image_level(const Image& image, const std::string& name);
  static Level thinned(const Level& level);
  static Level filtered(const Level& from, int rows, float variance);
  static Vec3f filtered_texel(const Level& from, double colatitude, double u, double concentration);
  static Vec3d mean(const Level& level);
  static Vec3f sample(const Level& level, const Vec2f& place);

  std::vector<Level> levels_;
};

/// Reads and filters the environment of a scene that names one, for the Shader to find it:
/// "sky" is procedural_sky(), everything else a file that read_image() reads. Nothing happens where
/// there is none, or where it has been loaded. Throws Error naming the file.
SURFEL_API void load_environment(Scene& scene);

}  // namespace surfel
