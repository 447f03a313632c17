#pragma once

#include <surfel/align/scan.h>
#include <surfel/base/export.h>

namespace surfel {

/// Points of several scans in one frame, with normals of any side: what a scan is moved onto.
struct IcpTarget {
  Array<Vec3f> position;
  Array<Vec3f> normal;
};

/// Adds the points of a scan that have a normal, at most `most`, spread evenly.
SURFEL_API void add_to_target(const Scan& scan, const RigidPose& pose, std::size_t most,
                              IcpTarget& target);

/// Moves up to `most` points of a scan onto the planes of a target by PCL's iterative closest
/// points (Chen, Medioni 1992; in libsurfel_icp.so, loaded when first needed), first with points up
/// to `reach` apart, then a quarter of it. The start comes back where there is no solution, or one
/// that moves the scan's centre by more than twice the reach. Throws Error(kIo) if the plug-in
/// cannot be loaded.
SURFEL_API RigidPose icp_pose(const Scan& scan, const RigidPose& start, const IcpTarget& target,
                              double reach, std::size_t most);

}  // namespace surfel
