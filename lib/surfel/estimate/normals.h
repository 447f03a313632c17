#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/types.h>
#include <surfel/surface/neighbor_search.h>

namespace surfel {

/// Which points make up a neighbourhood. The point itself counts as one of them.
struct NormalOptions {
  int k = 16;             ///< Nearest points; 3 to 65535. Unused if `adaptive` or `radius` is set.
  bool adaptive = false;  ///< A number per point from [k_min, k_max], see estimate_normals().
  int k_min = 12;         ///< 4 to k_max.
  int k_max = 64;         ///< Up to 65535.
  double radius = 0;      ///< Above 0: all points within it (inclusive; of more than 65535 the
                          ///< nearest). Not together with `adaptive`. Scene units.
  bool grow_in_noise = true;  ///< Where noise exceeds the spacing, neighbourhoods are as large as
                              ///< it asks for, see noisy_normals.h; not with `radius`.
  /// Where the points may have been seen from: used in noise, and only if they are a range image
  /// from there (range_normals.h).
  std::optional<Vec3d> sensor = std::nullopt;
  SURFEL_API std::vector<std::string> problems() const;  ///< Empty if usable.
};

/// How far a normal can be trusted. With the last three flags the normal is zero, and so are
/// curvature and confidence.
enum class PointFlag : std::uint8_t {
  kGood,
  kThin,        ///< The neighbourhood is over five times as long as wide, however large: the normal
                ///< may be turned about the long axis.
  kTooFew,      ///< Fewer than three points.
  kCoincident,  ///< All points are at one place, as far as floats can tell.
  kCollinear    ///< All points are on one line.
};
constexpr std::size_t kPointFlags = 5;

/// Shape and reliability of the neighbourhood that a normal was made from.
struct NormalQuality {
  float curvature;   ///< Surface variation lambda_0 / (lambda_0 + lambda_1 + lambda_2), 0 to 1/3.
                     ///< [Pauly, Gross, Kobbelt 2002, section 3.1]
  float confidence;  ///< One minus the normal's standard error in radians, at least 0.
  std::uint16_t neighbors;  ///< Points that the normal was made from.
  PointFlag flag;

  bool operator==(const NormalQuality&) const = default;
};

/// Normals of points, a value per point in each array.
struct NormalEstimate {
  Array<Vec3f> normal;  ///< Unit length, of arbitrary side: the component of largest magnitude
                        ///< is positive. Zero = unknown.
  Array<NormalQuality> quality;
  std::array<std::size_t, kPointFlags> flagged{};  ///< Points by flag.
  std::size_t neighbors = 0;  ///< Sum of the points that each normal was made from.
  std::size_t extended = 0;   ///< Points whose neighbourhood was enlarged, being thin at first.
  std::size_t remade = 0;     ///< Points whose normal was made anew, as noise exceeds the spacing.
  Array<float> noise;  ///< Standard deviation of the points from the surface where normals were
                       ///< made anew, scene units; else empty.

  std::size_t count(PointFlag f) const { return flagged[static_cast<std::size_t>(f)]; }
};

/// Normals of points by principal component analysis: the eigenvector of the smallest eigenvalue
/// lambda_0 of the neighbourhood's covariance about its centroid, in double from the offsets to the
/// point [Hoppe et al. 1992]. `search` searches `points`, which are finite.
///
/// The standard error of the normal of n points with eigenvalues l0 <= l1 <= l2 is
///   s^2 = noise / n (l1 / (l1 - l0)^2 + l2 / (l2 - l0)^2),  noise = l0 n / (n - 3),
/// the asymptotic variance of an eigenvector [Anderson 1963] with the n - 3 degrees of freedom that
/// a plane leaves.
///
/// Scan lines: where the nearest points all lie along one line (l1 < 0.04 l2) or at one place,
/// their number is doubled, up to 128, until they do not; not with `radius`.
///
/// Adaptive size: the normals of k_min, sqrt(2) k_min, 2 k_min ... k_max points are compared. The
/// largest number is taken up to which each normal agrees with every normal of fewer points: they
/// differ by at most 1.8 (s + s'), s being taken with the least noise seen at this point. Errors of
/// chance shrink as the number grows; the number is large enough when a systematic error, of
/// curvature or an edge, shows among them (intersection of confidence intervals [Lepskii 1990;
/// Goldenshluger, Nemirovski 1997]). The closed formula of Mitra, Nguyen, Guibas 2004 is not used:
/// it needs the curvature, which is not known where noise is strong. Relief finer than the spacing
/// cannot be told from noise: there k = 16 is better.
///
/// Normals do not depend on the number of threads. Throws Error(kUsage) for bad options, or if
/// `search` has another number of points.
SURFEL_API NormalEstimate estimate_normals(const Array<Vec3f>& points, const NeighborSearch& search,
                                           const NormalOptions& options = {});

}  // namespace surfel
