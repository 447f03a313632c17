#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <surfel/align/scan.h>
#include <surfel/base/export.h>

namespace surfel {

/// A point of one scan and the point of another that is nearest to it.
struct ScanMatch {
  std::uint32_t from;  ///< Point of the scan that looks.
  std::uint32_t to;    ///< Point of the scan that is looked at.
};

/// Matches of up to `most` points of a scan, spread evenly, with points of another scan, by
/// ascending `from`. The counterpart is the other scan's nearest point, if it is no further than
/// `reach`, lies inside its surface and not at the border (beyond which the scans do not overlap),
/// and both normals agree to 45 degrees.
/// \param relative  from the first scan's frame to the other's.
SURFEL_API std::vector<ScanMatch> match_scans(const Scan& from, const Scan& to,
                                              const RigidPose& relative, double reach,
                                              std::size_t most);

/// Points that match_scans() looks at.
SURFEL_API std::size_t matched_points(const Scan& from, std::size_t most);

}  // namespace surfel
