#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include <surfel/base/elementary.h>
#include <surfel/base/group_by_key.h>
#include <surfel/base/parallel.h>
#include <surfel/sample/mesh_edges.h>
#include <surfel/sample/smooth_normals.h>

namespace surfel {
namespace {

constexpr std::size_t kVertexGrain = 1 << 13;
constexpr std::size_t kMostCompared = 256;  ///< Faces of a vertex: all pairs of them are compared.

/// The wedges (3 * face + corner) at each welded vertex.
Grouped<std::uint32_t> wedges_at_vertices(const TriangleMesh& mesh) {
  const Array<std::uint32_t> welded = welded_vertices(mesh.position);
  return group_by_key<std::uint32_t>(mesh.position.size(), [&](const auto& add) {
    for (std::uint32_t i = 0; i < 3 * mesh.face.size(); ++i) {
      add(welded[mesh.face[i / 3][i % 3]], i);
    }
  });
}

/// Contribution of a face to the normal at one of its corners.
struct Contribution {
  Vec3d normal;  ///< Normal of the face; zero where the face has no area.
  double angle;  ///< Angle of the face at the corner.
};

Contribution contribution(const TriangleMesh& mesh, std::uint32_t wedge) {
  const auto& face = mesh.face[wedge / 3];
  const std::uint32_t k = wedge % 3;
  const Vec3d at = mesh.position[face[k]].cast<double>();
  const Vec3d a = mesh.position[face[(k + 1) % 3]].cast<double>() - at;
  const Vec3d b = mesh.position[face[(k + 2) % 3]].cast<double>() - at;
  const Vec3d cross = a.cross(b);
  const double length = cross.norm();
  if (!(length > 0)) return {Vec3d::Zero(), 0};
  return {cross / length, portable::atan2(length, a.dot(b))};
}

Vec3f unit(const Vec3d& sum) {
  const double length = sum.norm();
  return length > 1e-12 ? Vec3f((sum / length).cast<float>()) : Vec3f::Zero();
}

/// Whether no two of the faces can be further apart than the crease angle.
bool is_smooth(const std::vector<Contribution>& faces, const Vec3d& mean, double crease_angle) {
  const double half = portable::cos(crease_angle / 2);
  return std::all_of(faces.begin(), faces.end(), [&](const Contribution& c) {
    return c.angle == 0 || c.normal.dot(mean) >= half;
  });
}

}  // namespace

Array<std::array<Vec3f, 3>> smooth_normals(const TriangleMesh& mesh, double crease_angle) {
  const Grouped<std::uint32_t> around = wedges_at_vertices(mesh);
  // Faces of one plane meet at an angle of zero, whatever rounding makes of it.
  const double least_cosine = portable::cos(crease_angle) - 1e-9;
  Array<std::array<Vec3f, 3>> normals(mesh.face.size());
  const auto at = [&](std::uint32_t wedge) -> Vec3f& { return normals[wedge / 3][wedge % 3]; };
  parallel_for(mesh.position.size(), kVertexGrain, [&](std::size_t begin, std::size_t end, int) {
    std::vector<Contribution> faces;
    for (std::size_t v = begin; v < end; ++v) {
      faces.clear();
      Vec3d sum = Vec3d::Zero();
      for (std::uint64_t i = around.begin[v]; i < around.begin[v + 1]; ++i) {
        faces.push_back(contribution(mesh, around.item[i]));
        sum += faces.back().angle * faces.back().normal;
      }
      const Vec3f mean = unit(sum);
      const bool one_for_all =
          faces.size() > kMostCompared || is_smooth(faces, mean.cast<double>(), crease_angle);
      for (std::size_t i = 0; i < faces.size(); ++i) {
        Vec3f& normal = at(around.item[around.begin[v] + i]);
        normal = mean;
        if (one_for_all || faces[i].angle == 0) continue;
        Vec3d own = Vec3d::Zero();
        for (const Contribution& c : faces) {
          if (c.normal.dot(faces[i].normal) >= least_cosine) own += c.angle * c.normal;
        }
        normal = unit(own);
      }
    }
  });
  return normals;
}

}  // namespace surfel
