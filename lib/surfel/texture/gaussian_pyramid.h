#pragma once

#include <memory>
#include <span>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/scene/wrap_mode.h>
#include <surfel/texture/texel_kernel.h>
#include <surfel/texture/texel_tiles.h>

namespace surfel {

/// Texels of a level along one axis: texel i, of `count` from `first` on, has its centre at
/// (i + 1/2) pitch.
struct TexelAxis {
  int first = 0;
  int count = 0;
  double pitch = 1;  ///< Texels of the image.
};

/// Where texel i is stored, counted from `first`; -1 if there is none.
int stored_offset(int i, const TexelAxis& axis, WrapMode wrap);

/// Four floats a texel (R, G, B, weight, all premultiplied by the weight), row by row. A level that
/// no kernel needs has no texels.
struct PyramidLevel {
  TexelAxis x;
  TexelAxis y;
  Array<float> texels{};
  std::shared_ptr<const TexelTiles> tiles{};  ///< Instead of `texels`, of an image.

  const float* row(int offset) const {
    return texels.data() + static_cast<std::size_t>(offset) * x.count * 4;
  }
  Eigen::Array4f texel(int x_offset, int y_offset) const {
    if (tiles) return tiles->texel(x_offset, y_offset);
    return Eigen::Map<const Eigen::Array4f>(row(y_offset) +
                                            static_cast<std::ptrdiff_t>(x_offset) * 4);
  }
};

/// A level's row, by its offset.
struct TexelRow {
  int offset;
  const float* texels;
};

/// The pyramid levels that a set of kernels belongs on.
struct LevelRange {
  int finest = 0;
  int coarsest = 0;
};

/// Makes a pyramid's levels from an image whose rows come in pieces. Of the image, and of levels
/// that are not wanted, only the rows that still have a part in other levels' rows are kept.
class SURFEL_API PyramidStream {
 public:
  /// \param x       Columns of the image that come.
  /// \param y       Rows of the image that come.
  /// \param wrap    Continues the image beyond its borders.
  /// \param wanted  Levels from 1 on; fewer are made where they come down to a single texel.
  PyramidStream(const TexelAxis& x, const TexelAxis& y, WrapMode wrap, const LevelRange& wanted);
  ~PyramidStream();
  PyramidStream(PyramidStream&&) noexcept;
  PyramidStream& operator=(PyramidStream&&) = delete;

  /// The memory that the wanted levels take, roughly.
  double bytes() const;
  /// Each row of the image once. The order and the pieces matter for rounding alone. In parallel.
  void add(std::span<const TexelRow> rows);
  /// Levels 1 ... coarsest, once all rows have been added.
  std::vector<PyramidLevel> take();

 private:
  class Step;
  std::vector<std::unique_ptr<Step>> steps_;
};

/// Sums of texels under a Gaussian kernel, at a cost that does not grow with the kernel.
///
/// Level l holds the image convolved with a Gaussian of variance kPrefilter pitch^2 along each
/// axis, sampled every `pitch` texels (2^l; a little less where a size is not a power of two, so
/// that the image stays a whole number of texels and wraps). A kernel of variance M is evaluated on
/// the coarsest level that leaves its minor axis at least kResidual, with variance
/// M - kPrefilter pitch^2: Gaussians convolve to Gaussians, so only the sampling between them costs
/// accuracy. A sine wave of frequency f per level texel aliases by
/// exp(-2 pi^2 [kPrefilter (1 - f)^2 + kResidual f^2]), which is at most
/// exp(-2 pi^2 kPrefilter kResidual / (kPrefilter + kResidual)) = 1.0e-3 of its amplitude.
class SURFEL_API GaussianPyramid {
 public:
  static constexpr double kPrefilter = 0.7;
  static constexpr double kResidual = 0.7;
  /// Texels where the kernel's exponent exceeds this are left out: exp(-10) = 4.5e-5 of the peak,
  /// and as much of the volume, so that no sum is off by more than 5e-5 of the image's range.
  static constexpr double kExponentCutoff = 10;
  static constexpr int kMaxLevel = 30;  ///< No image has more than 2^30 texels a side.

  /// Level 0 alone.
  /// \param image  Its pitch is 1; `first` is 0 unless `wrap` is kNothing.
  /// \param wrap   Continues the image beyond its borders.
  GaussianPyramid(PyramidLevel image, WrapMode wrap);
  /// A pyramid with the levels from 1 on as PyramidStream made them; kernels must belong on levels
  /// that have texels.
  GaussianPyramid(PyramidLevel image, std::vector<PyramidLevel> levels, WrapMode wrap);

  /// The level that a kernel whose smaller principal variance is `minor` texel^2 belongs on.
  static int level_for(double minor);
  /// Builds the levels up to `level`, or up to a single texel. In parallel.
  void build(int level);

  /// Sum over the texels of kernel times texel, the kernel's peak being 1 at its centre.
  struct Sum {
    /// Sums of R, G, B and weight; not aligned, as in base/types.h.
    Eigen::Array<double, 4, 1, Eigen::DontAlign> texels{0, 0, 0, 0};
    double kernel = 0;  ///< Sum of the kernel over the texels that exist.
  };
  /// Filters the image with a kernel; where that interpolates() the image's own texels bilinearly.
  /// \param kernel     Centre and variance in texels of level 0.
  /// \param max_level  The coarsest level to use; 0: the image's own texels, whatever it takes. A
  ///                   level that was not built is replaced by the coarsest there is.
  Sum filter(const TexelKernel& kernel, int max_level = kMaxLevel) const;

  /// Box around the image's texels that the kernel reaches on level 0, beyond its borders too.
  struct Box {
    int x_begin, x_end, y_begin, y_end;
  };
  Box reach(const TexelKernel& kernel) const;

  /// Adds bilinear lookup at a place in texels of level 0, which may lie beyond the borders.
  void add_lookup(const Vec2d& place, double weight, Sum& sum) const;

  const PyramidLevel& image() const { return levels_.front(); }
  const PyramidLevel& level(int l) const { return levels_[static_cast<std::size_t>(l)]; }
  int level_count() const { return static_cast<int>(levels_.size()); }
  WrapMode wrap() const { return wrap_; }

 private:
  Sum interpolate(const TexelKernel& kernel) const;

  WrapMode wrap_;
  std::vector<PyramidLevel> levels_;
};

}  // namespace surfel
