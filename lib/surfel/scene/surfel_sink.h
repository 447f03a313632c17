#pragma once

#include <cstddef>

#include <surfel/scene/surfel_cloud.h>

namespace surfel {

/// Where surfels go that are made block by block.
class SurfelSink {
 public:
  SurfelSink() = default;
  virtual ~SurfelSink() = default;
  SurfelSink(const SurfelSink&) = delete;
  SurfelSink& operator=(const SurfelSink&) = delete;

  /// Announces how many surfels will come, and the columns that they will have. What came after an
  /// earlier call is void.
  virtual void begin(const SurfelCloud& like, std::size_t count) = 0;
  /// Takes the next surfels, which are the result's from `at` on.
  virtual void put(SurfelCloud surfels, std::size_t at) = 0;
};

}  // namespace surfel
