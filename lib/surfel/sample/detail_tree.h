#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/sample/sizing_field.h>

namespace surfel {

/// Look of a surface at one place.
struct SurfaceProbe {
  Vec3f position;
  Vec3f normal;
  Vec3f color;      ///< Linear light.
  float alpha = 1;  ///< Opacity: a further channel of colour.
  /// Three further channels: the part of the light that the normal decides.
  Vec3f shading{0, 0, 0};
  float weight = 1;  ///< Share of the surface, by the sum of all probes' weights; >= 0.
};

/// A piece of an open border.
struct BorderPiece {
  Vec3f middle;
  float length;
};

/// The error that surfels of a given spacing make in every part of a surface, and the cheapest
/// choice of spacings.
///
/// Cells of an octree stand for kernels of standard deviation sigma = side / kCellSigmas. A cell's
/// error is, as an integral over the surface in it,
/// - of colour: the squared difference, summed over the channels and divided by three, between the
///   colour and its best affine function of the place. With kCellSigmas = 4 this is about the
///   difference that a Gaussian blur of variance 1.42 sigma^2 makes, the blur of view-independent
///   EWA drawn at cutoff 1: for a colour of curvature c'' 0.36 against 0.50 c''^2 sigma^4, for a
///   step of height 1 0.25 sigma against 0.28 sigma per length, and both the variance where detail
///   is finer than the kernel;
/// - of the shape: the mean squared distance from the best plane (0.6 sigma^2 over the radius of
///   curvature in the mean), and at open borders, beyond which kernels reach, sigma^2 in a strip of
///   sigma / 2; in units of `unit_deviation`, the distance that counts as much as black against
///   white.
/// Sheets that face opposite ways are measured apart. There are two octrees, shifted by a third of
/// their side: an edge along the border of two cells, which neither cell sees, is inside cells of
/// the other octree, at all levels. Errors are the mean of both octrees, spacings the smaller one.
class SURFEL_API DetailTree {
 public:
  static constexpr double kCellSigmas = 4;

  struct Options {
    double area;            ///< Area of the surface, > 0.
    double probe_spacing;   ///< Root of the area per probe, > 0: the smallest sigma, too.
    double unit_deviation;  ///< Scene units, > 0.
    double variance_scale;  ///< sigma in units of the spacing, > 0.
    /// The probes are surfels, which may stay as they are: in the smallest cells this costs one
    /// sample a probe, and makes no error.
    bool keep = false;
    std::vector<std::string> problems() const;  ///< Empty if usable.
  };

  /// \param probes  one at least, in any order. Throws Error(kUsage) for bad options.
  DetailTree(const std::vector<SurfaceProbe>& probes, const std::vector<BorderPiece>& border,
             const Options& options);

  /// Chosen cells of the octree.
  struct Cut {
    /// The parts of the cells that have detail, each with its spacing, for a SizingField.
    std::vector<SizingCell> cells;
    double samples = 0;         ///< Area of the whole cells in units of their spacings squared.
    double finest_samples = 0;  ///< The part of `samples` in cells that cannot be divided further.
    double color_error = 0;     ///< Root mean square over the surface.
    double shape_error = 0;     ///< Root mean square, in units of unit_deviation.
    double error() const;       ///< Root of the sum of both errors' squares.
  };

  /// The cells that minimise error()^2 + price * samples: where a further sample would lower the
  /// squared error by less than the price, none is spent.
  Cut cut(double price) const;
  /// Bounds of useful prices.
  double lowest_price() const;
  double highest_price() const;
  /// Spacing of the coarsest cell.
  double largest_spacing() const;

  /// Change of a field's spacing by distance: the most that samples allow which are to see each
  /// other (PoissonDisk::kMaxGradient), with some left for the factor that a count needs. Between
  /// 0.2 and 0.6 the error for a number of surfels hardly depends on it.
  static constexpr double kGradient = 0.35;
  SizingField field(const Cut& cut) const { return {cut.cells, kGradient, largest_spacing()}; }

 private:
  struct Errors {
    double color = 0;
    double shape = 0;
    double sum() const { return color + shape; }
  };
  /// Nodes are in post-order, one octree after the other: a node's subtree is [first, itself].
  struct Node {
    Vec3f min;
    int level;  ///< The cell's side is leaf_side * 2^level.
    std::uint32_t first;
    double area;
    double probes;  ///< Number of the cell's probes.
    Errors own;     ///< Integrals, with the cell's sigma ...
    Errors halved;  ///< ... and with sigma / sqrt 2, between the cell's and its children's.
  };
  class Builder;
  static constexpr int kOctrees = 2;  ///< Shifted against each other, see DetailTree.
  /// The cheapest choice for a node at a price: to divide it, to use its own spacing, to use the
  /// spacing of half the variance, or to keep its surfels.
  enum class Choice : std::uint8_t { kDivide, kOwn, kHalved, kKeep };

  /// Cells of the parts of a node that need its spacing.
  void add_cells(std::size_t index, float spacing, int levels,
                 std::vector<SizingCell>& cells) const;
  double measured_area() const;  ///< Area of the surface, as the probes sum it up in each octree.
  double side(int level) const;
  double spacing(const Node& node) const;

  Options options_;
  double leaf_side_;
  std::vector<Node> node_;
};

}  // namespace surfel
