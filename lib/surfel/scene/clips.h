#pragma once

#include <cstddef>

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Is a surfel cut by a half-plane (SurfelCloud::clip1, clip2)?
inline bool is_clipped(const SurfelCloud& cloud, std::size_t i) {
  return (!cloud.clip1.empty() && !cloud.clip1[i].isZero(0)) ||
         (!cloud.clip2.empty() && !cloud.clip2[i].isZero(0));
}

/// Does a half-plane cut off the surfel's centre? It continues other surfels up to their common
/// line, and stands for no surface where the line is dropped.
inline bool is_cut_off(const SurfelCloud& cloud, std::size_t i) {
  return (!cloud.clip1.empty() && !cloud.clip1[i].isZero(0) && cloud.clip1_distance[i] < 0) ||
         (!cloud.clip2.empty() && !cloud.clip2[i].isZero(0) && cloud.clip2_distance[i] < 0);
}

}  // namespace surfel
