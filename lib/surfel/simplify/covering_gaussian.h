#pragma once

#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/surfel_merge.h>

namespace surfel {

/// A disc that a surfel has to cover.
struct CoveredPlace {
  Vec3f position;
  float area;  ///< Area of surface that the place stands for, unit^2, >= 0.
};

/// Radius of a place's disc, by the root of its area. Half is too little, as cells have corners:
/// pictures are seen through. With more silhouettes come out larger.
inline constexpr double kPlaceReach = 0.85;

/// The Gaussian about `position`, in the plane across `normal`, whose kernel, cut off at beta =
/// `cutoff`, holds the discs around all the places (one at least): a disc, or an ellipse with the
/// axes of the places' second moments, no longer than kMostElongated : 1. So the surfel of a piece
/// of surface ends where the piece does, also at a border. The variances are positive unless all
/// areas are zero and all places at `position`.
SURFEL_API TangentGaussian covering_gaussian(const Vec3f& position, const Vec3f& normal,
                                             std::span<const CoveredPlace> places, bool ellipse,
                                             double cutoff);

}  // namespace surfel
