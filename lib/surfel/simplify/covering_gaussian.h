#pragma once

#include <span>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/lod/surfel_merge.h>

namespace surfel {

/// What a surfel has to cover: a disc around a place.
struct CoveredPlace {
  Vec3f position;
  float area;  ///< That it stands for, unit^2, >= 0.
};

/// How far a place is to be covered, by the root of its area. (Half is too little, as cells have
/// corners: on a photographed statue, thinned to a third, 0.5 % of the pixels were seen through at
/// 0.5, 0.1 % at 0.75, 0.03 % at 0.9; beyond, silhouettes come out larger.)
inline constexpr double kPlaceReach = 0.85;

/// The Gaussian about `position`, in the plane across `normal`, whose kernel, cut off at beta =
/// `cutoff`, holds the discs around all the places: a disc, or an ellipse with the axes of the
/// places' second moments, no longer than 16 : 1. So what stands for a piece of surface ends where
/// the piece does, also at a border. At least one place; positive unless all areas are zero and all
/// places at `position`.
SURFEL_API TangentGaussian covering_gaussian(const Vec3f& position, const Vec3f& normal,
                                             std::span<const CoveredPlace> places, bool ellipse,
                                             double cutoff);

}  // namespace surfel
