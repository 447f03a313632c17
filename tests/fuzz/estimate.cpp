#include <cmath>
#include <cstring>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/estimate/estimate.h>

#include "fuzz/checks.h"

namespace surfel::fuzz {
namespace {

template <class T>
bool same_bytes(const Array<T>& a, const Array<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

bool finite(float x) { return std::isfinite(x); }
bool finite(const Vec3f& x) { return x.allFinite(); }

template <class T>
bool finite(const Array<T>& column) {
  for (const T& x : column) {
    if (!finite(x)) return false;
  }
  return true;
}

SurfelCloud estimated(const SurfelCloud& points, const EstimateOptions& options, int threads) {
  set_thread_count(threads);
  return estimate_surfels(points, options, nullptr, "points");
}

}  // namespace

/// Estimates surfels of points that the bytes are: all numbers of the result are finite, and three
/// threads give the bytes that one gives, where they are asked (on_three_threads()).
void estimate(Bytes bytes) {
  CloudNumbers numbers(bytes);
  SurfelCloud points;
  // Random points are all at borders, where each looks at all others: most inputs have few.
  const int size = numbers.choice() / 4;
  const std::size_t most = bytes.size() % 32 == 1 ? 100 : size % 4 == 1 ? 32 : 12;
  while (!numbers.done() && points.size() < most) {
    Vec3f p;
    for (float& x : p) x = numbers.length();
    points.position.push_back(p);
  }
  constexpr Orientation kMethods[] = {Orientation::kMst, Orientation::kOutward, Orientation::kNone,
                                      Orientation::kWinding};
  EstimateOptions options;
  options.orientation.method = kMethods[numbers.choice() % 4];
  if (numbers.choice() / 4 % 4 == 3) options.edges.emplace();
  try {
    const SurfelCloud one = estimated(points, options, 1);
    require(finite(one.normal) && finite(one.variance) && finite(one.area) && finite(one.tangent) &&
                finite(one.variance_u) && finite(one.variance_v) && finite(one.clip1) &&
                finite(one.clip1_distance) && finite(one.clip2) && finite(one.clip2_distance),
            "a number that is not finite");
    if (!on_three_threads(bytes)) return;
    const SurfelCloud three = estimated(points, options, 3);
    require(same_bytes(one.position, three.position) && same_bytes(one.normal, three.normal) &&
                same_bytes(one.variance, three.variance) && same_bytes(one.area, three.area) &&
                same_bytes(one.variance_u, three.variance_u) &&
                same_bytes(one.variance_v, three.variance_v) &&
                same_bytes(one.clip1, three.clip1) &&
                same_bytes(one.clip1_distance, three.clip1_distance) &&
                same_bytes(one.clip2, three.clip2) &&
                same_bytes(one.clip2_distance, three.clip2_distance),
            "three threads give other bytes than one");
  } catch (const Error& error) {
    require(error.kind() == ErrorKind::kInput, error.what());
  }
}

}  // namespace surfel::fuzz
