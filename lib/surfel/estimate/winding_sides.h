#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <surfel/base/export.h>
#include <surfel/estimate/winding_dipoles.h>

namespace surfel {

/// Which way each sheet has to be turned, and what it is part of then.
struct WindingSides {
  /// Sheets that tell each other's sides; a solid's surface is one part, as is a solid's cavity.
  struct Part {
    double area = 0;      ///< Unit^2.
    double closed = 0;    ///< 1 - |vector area| / area: 1 of closed surfaces, 0 of planes.
    bool turned = false;  ///< All its sheets have to be turned once more.
  };
  struct Sheet {
    std::uint32_t part = 0;
    bool turned = false;  ///< Against the side that its points have.
    /// Share of its energies with other sheets that are below zero, less those above: 1 if all
    /// agree, or there are none; 0 if it could as well be the other way round.
    float certainty = 1;
  };
  std::vector<Part> part;
  std::vector<Sheet> sheet;
};

/// Finds the sides of sheets by the winding number. Points with areas and normals are dipoles: the
/// gradient of their winding number w is the vector field of the normals without its rotation. A
/// closed surface whose normals agree has none: w is 1 inside and 0 outside [Xu et al. 2023; Lin et
/// al. 2024]. Wherever sides change, or a surface ends, a vortex line runs, so that sides are
/// looked for at which the energy of the rotation is least: beside a gap, around a sharp edge, and
/// around the rim of a thin wall, the vortices at the borders of two sheets then cancel. The
/// energy of two dipoles p and q, d apart, blurred by eps is
///   R^-5 ((2 eps^2 - d^2) p . q + 3 (d . p) (d . q)) / 4 pi,  R^2 = d^2 + eps^2.
///
/// Energies between sheets are summed level by level: cells hold one dipole for each sheet, blurred
/// by 0.7 cells, less what cells of twice the edge see, in which the dipoles of the next level are
/// merged; so that only near cells meet on each level. Beyond the finest level only sheets of some
/// cells are seen, as only large sheets turn others far away. Then the two sheets of the largest
/// energy are joined, on the sides that make it negative, and so on until no energy is left; last,
/// single sheets are turned as long as that takes energy away.
///
/// Sheets without a common energy stay apart, such as nested closed surfaces. Closed parts face out
/// of their volume; parts within an odd number of others, which bound cavities, into it. Of parts
/// that enclose less than half a ball does, most of the area looks up.
///
/// Takes about 400 bytes a dipole. The result does not depend on the number of threads.
SURFEL_API WindingSides winding_sides(const WindingDipoles& points);

}  // namespace surfel
