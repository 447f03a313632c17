#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/sample/sizing_field.h>

namespace surfel {

/// What is known of a surface at one place.
struct SurfaceProbe {
  Vec3f position;
  Vec3f normal;
  Vec3f color;             ///< Linear light.
  float alpha = 1;         ///< Opacity: a further channel of colour.
  Vec3f shading{0, 0, 0};  ///< Three further channels: what of the light follows the normal.
  float weight = 1;        ///< Of all, its share of the surface; >= 0.
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
/// - of colour: the sum of the squares over the channels, divided by three, of what the best affine
///   function of the place leaves. Between a smooth texture and a sharp edge that is, with
///   kCellSigmas = 4, what a Gaussian blur of variance 1.42 sigma^2 takes away, that of
///   view-independent EWA drawn at cutoff 1: with curvature c'' of the colour 0.36 against 0.50
///   c''^2 sigma^4, for a step of height 1 0.25 sigma against 0.28 sigma per length, and both the
///   variance where detail is finer than the kernel;
/// - of the shape: the mean squared distance from the best plane (0.6 sigma^2 over the radius of
///   curvature in the mean), and at open borders, beyond which kernels reach, sigma^2 in a strip of
///   sigma / 2; in units of `unit_deviation`, the distance that counts as much as black against
///   white.
/// Sheets that face opposite ways are measured apart. There are two octrees, shifted by a third of
/// their side: what lies along the borders of cells in one, where neither side sees it, is inside
/// those of the other, at all levels. Errors are the mean of both, spacings the smaller one.
class SURFEL_API DetailTree {
 public:
  static constexpr double kCellSigmas = 4;

  struct Options {
    double area;            ///< Of the surface.
    double probe_spacing;   ///< Root of the area per probe. The smallest sigma is the same.
    double unit_deviation;  ///< Scene units.
    double variance_scale;  ///< sigma in units of the spacing.
    /// The probes are surfels, which may stay as they are: in the smallest cells that costs one
    /// sample a probe, and makes no error.
    bool keep = false;
  };

  /// \param probes  at least one, in any order.
  DetailTree(const std::vector<SurfaceProbe>& probes, const std::vector<BorderPiece>& border,
             const Options& options);

  /// Chosen cells of the octree.
  struct Cut {
    /// Their parts that have detail, each with its spacing, for a SizingField.
    std::vector<SizingCell> cells;
    double samples = 0;         ///< Area of the whole cells in units of their spacings squared.
    double finest_samples = 0;  ///< Of these, in cells that are not divided further.
    double color_error = 0;     ///< Root mean square over the surface.
    double shape_error = 0;     ///< The same, in units of unit_deviation.
    double error() const;       ///< Root of the sum of their squares.
  };

  /// The cells that minimise error()^2 + price * samples: where a further sample would lower the
  /// squared error by less than the price, none is spent.
  Cut cut(double price) const;
  /// Bounds of useful prices.
  double lowest_price() const;
  double highest_price() const;
  /// Spacing of the coarsest cell.
  double largest_spacing() const;

  /// Change of a field's spacing by distance: 0.35 is as much as samples that see each other allow
  /// (PoissonDisk::kMaxGradient), with some left for the factor that a count needs. Between 0.2 and
  /// 0.6 the error for a number of surfels hardly depends on it.
  static constexpr double kGradient = 0.35;
  SizingField field(const Cut& cut) const { return {cut.cells, kGradient, largest_spacing()}; }

 private:
  struct Errors {
    double color = 0;
    double shape = 0;
    double sum() const { return color + shape; }
  };
  /// In post-order, one octree after the other: a node's subtree is [first, itself].
  struct Node {
    Vec3f min;
    int level;  ///< Of the cell: its side is leaf_side * 2^level.
    std::uint32_t first;
    double area;
    double probes;  ///< Their number.
    Errors own;     ///< Integrals, with the cell's sigma ...
    Errors halved;  ///< ... and with sigma / sqrt 2, between the cell's and its children's.
  };
  class Builder;
  static constexpr int kOctrees = 2;
  /// What a node does at a price.
  enum class Choice : std::uint8_t { kDivide, kOwn, kHalved, kKeep };

  /// Cells of the parts of a node that need its spacing.
  void add_cells(std::size_t index, float spacing, int levels,
                 std::vector<SizingCell>& cells) const;
  double measured_area() const;  ///< The surface's, in every octree.
  double side(int level) const;
  double spacing(const Node& node) const;

  Options options_;
  double leaf_side_;
  std::vector<Node> node_;
};

}  // namespace surfel
