#include <cstddef>
#include <iterator>

#include <surfel/surface/coverage_threshold.h>

namespace surfel {

double coverage_threshold(double cutoff) {
  struct Point {
    double cutoff, tau;
  };
  // The sum of rho that all but 1 in 100,000 pixels inside a magnified jittered grid (V = h^2 I,
  // jitter 0.35 h, 6 grids) reach.
  static constexpr Point kMeasured[] = {{0, 0},    {0.5, 0.1}, {1, 0.31},  {1.5, 0.51},
                                        {2, 0.61}, {3, 0.74},  {4, 0.775}, {16, 0.795}};
  for (std::size_t i = 1; i < std::size(kMeasured); ++i) {
    const Point& a = kMeasured[i - 1];
    const Point& b = kMeasured[i];
    if (cutoff <= b.cutoff) {
      return a.tau + (b.tau - a.tau) * (cutoff - a.cutoff) / (b.cutoff - a.cutoff);
    }
  }
  return std::end(kMeasured)[-1].tau;
}

}  // namespace surfel
