#pragma once

#include <cstddef>
#include <vector>

#include <surfel/base/export.h>

namespace surfel {

/// Width of the blur of dipoles, eps, in cells.
inline constexpr float kDipoleBlur = 0.7F;

/// Dipoles in and around a block of cells, by coordinate.
struct DipoleColumns {
  std::vector<float> x, y, z;  ///< Places, in cells.
  std::vector<float> p, q, r;  ///< Moments, in cells^2: areas times normals.
  std::vector<float> energy;   ///< Set by dipole_energies().

  /// Makes room for so many dipoles. What is beyond them may be read and written.
  void resize(std::size_t count) {
    constexpr std::size_t kMostLanes = 16;
    for (auto* column : {&x, &y, &z, &p, &q, &r, &energy}) column->resize(count + kMostLanes);
  }
};

/// Sets the energies, times 4 pi, between dipole `i` and each from `first` to `end`, see
/// winding_sides().
/// \param whole  the energies of dipoles blurred by eps; else less the energies of the same dipoles
///               blurred by twice that, which the next level has.
SURFEL_API void dipole_energies(std::size_t i, std::size_t first, std::size_t end, bool whole,
                                DipoleColumns& dipoles);

}  // namespace surfel
