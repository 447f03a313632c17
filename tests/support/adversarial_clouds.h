#pragma once

#include <cstddef>
#include <ostream>
#include <string>
#include <vector>

namespace surfel::test {

/// Surfels, or a mesh, that make a careless search or loop slow: the geometry of which time and
/// memory shall depend no more than on that of a sphere of the same size, the case `benign`.
struct AdversarialCase {
  std::string name;
  std::string what;  ///< In a few words, for a table.

  friend std::ostream& operator<<(std::ostream& out, const AdversarialCase& one) {
    return out << one.name;
  }
};

/// Clouds by name, `benign` first.
std::vector<AdversarialCase> adversarial_clouds();
/// One of them as a binary PLY file of `count` surfels: x y z, normal, variance, area, colour,
/// alpha, and group (8 groups in turn) where `grouped` is set.
std::string adversarial_cloud(const std::string& name, std::size_t count, bool grouped = false);
/// The same as a scanner's points: x y z alone.
std::string adversarial_points(const std::string& name, std::size_t count);

/// Meshes by name, `benign` first.
std::vector<AdversarialCase> adversarial_meshes();
/// One of them as an OBJ file of about `count` triangles.
std::string adversarial_mesh(const std::string& name, std::size_t count);

}  // namespace surfel::test
