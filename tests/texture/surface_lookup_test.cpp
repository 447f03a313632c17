#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/io/mesh_io.h>
#include <surfel/sample/mesh_sampler.h>
#include <surfel/texture/surface_lookup.h>

#include "sample/test_meshes.h"
#include "support/test_data.h"

namespace surfel {
namespace {

using namespace test;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Surfels of standard deviation `sigma` without normal.
SurfelCloud cloud_at(std::initializer_list<Vec3f> positions, float sigma = 1) {
  SurfelCloud cloud;
  cloud.position.assign(positions.begin(), positions.end());
  cloud.variance.assign(cloud.size(), sigma * sigma);
  return cloud;
}

/// Square [0, 1]^2 at the height z, with (u, v) = (x, y) + shift; it looks up, or down.
void add_square(TriangleMesh& mesh, float z, bool up, const Vec2f& shift) {
  const std::array<Vec2f, 4> at{Vec2f(0, 0), Vec2f(1, 0), Vec2f(1, 1), Vec2f(0, 1)};
  for (std::array<int, 3> t : {std::array{0, 1, 2}, std::array{0, 2, 3}}) {
    if (!up) std::swap(t[1], t[2]);
    const auto corner = [&](int k) { return Vec3f(at[t[k]].x(), at[t[k]].y(), z); };
    add_triangle(mesh, corner(0), corner(1), corner(2));
    mesh.wedge_uv.push_back({at[t[0]] + shift, at[t[1]] + shift, at[t[2]] + shift});
  }
}

TriangleMesh square() {
  TriangleMesh mesh;
  add_square(mesh, 0, true, {0, 0});
  return mesh;
}

/// The triangle's point nearest to p, found by its plane and its edges in turn.
Vec3d closest_point(const Vec3d& p, const std::array<Vec3d, 3>& t) {
  const Vec3d normal = (t[1] - t[0]).cross(t[2] - t[0]).normalized();
  const Vec3d q = p - normal * normal.dot(p - t[0]);
  bool inside = true;
  Vec3d best = t[0];
  for (int k = 0; k < 3; ++k) {
    const Vec3d edge = t[(k + 1) % 3] - t[k];
    inside = inside && normal.dot(edge.cross(q - t[k])) >= 0;
    const double s = std::clamp(edge.dot(p - t[k]) / edge.squaredNorm(), 0.0, 1.0);
    const Vec3d on_edge = t[k] + s * edge;
    if ((on_edge - p).norm() < (best - p).norm()) best = on_edge;
  }
  return inside ? q : best;
}

std::array<Vec3d, 3> corners(const TriangleMesh& mesh, std::size_t face) {
  std::array<Vec3d, 3> t;
  for (int k = 0; k < 3; ++k) t[k] = mesh.position[mesh.face[face][k]].cast<double>();
  return t;
}

class RandomMesh {
 public:
  explicit RandomMesh(unsigned seed) : generator_(seed) {}
  float uniform() { return std::uniform_real_distribution<float>(-1, 1)(generator_); }
  Vec3f point() { return {uniform(), uniform(), uniform()}; }

  /// Triangles of all sizes down to size^10, each with uv of its own.
  TriangleMesh soup(int faces, float size) {
    TriangleMesh mesh;
    for (int i = 0; i < faces; ++i) {
      const Vec3f center = point();
      const float scale = std::pow(size, static_cast<float>(1 + i % 10));
      add_triangle(mesh, center + scale * point(), center + scale * point(),
                   center + scale * point());
      mesh.wedge_uv.push_back(
          {Vec2f(uniform(), uniform()), Vec2f(uniform(), uniform()), Vec2f(uniform(), uniform())});
    }
    return mesh;
  }

 private:
  std::mt19937 generator_;
};

TEST(SurfaceLookup, FindsWhatTryingAllFacesFinds) {
  for (const int faces : {1, 3, 4, 5, 16, 17, 300}) {
    RandomMesh random(static_cast<unsigned>(faces));
    const TriangleMesh mesh = random.soup(faces, 0.7F);
    SurfelCloud cloud;
    for (int i = 0; i < 500; ++i) {
      cloud.position.push_back(1.5F * random.point());
      cloud.normal.push_back(i % 5 == 0 ? Vec3f(0, 0, 0) : Vec3f(random.point().normalized()));
      cloud.variance.push_back(std::pow(0.1F * (1 + 2 * random.uniform()), 2.0F));
    }
    const SurfaceLookupReport report = locate_on_mesh(cloud, mesh);

    std::size_t too_far = 0;
    std::size_t turned_away = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3d p = cloud.position[i].cast<double>();
      const double sigma = std::sqrt(static_cast<double>(cloud.variance[i]));
      double least = kInfinity;
      Vec2d uv = Vec2d::Constant(kNan);
      bool turned = false;
      for (std::size_t f = 0; f < mesh.face.size(); ++f) {
        const std::array<Vec3d, 3> t = corners(mesh, f);
        const Vec3d q = closest_point(p, t);
        const Vec3d normal = (t[1] - t[0]).cross(t[2] - t[0]);
        const bool away = normal.dot(cloud.normal[i].cast<double>()) < 0;
        const double cost = away ? 2 * (q - p).norm() + sigma : (q - p).norm();
        if ((q - p).norm() > 3 * sigma || cost >= least) continue;
        least = cost;
        turned = away;
        uv.setZero();
        for (int k = 0; k < 3; ++k) {
          const double part =
              (t[(k + 2) % 3] - t[(k + 1) % 3]).cross(q - t[(k + 1) % 3]).dot(normal);
          uv += part / normal.squaredNorm() * mesh.wedge_uv[f][k].cast<double>();
        }
      }
      if (std::isinf(least)) {
        ++too_far;
        EXPECT_TRUE(std::isnan(cloud.uv[i].x()) && std::isnan(cloud.uv[i].y()));
      } else {
        turned_away += turned;
        EXPECT_LT((cloud.uv[i].cast<double>() - uv).norm(), 1e-5) << faces << " faces, " << i;
      }
    }
    EXPECT_EQ(report.too_far, too_far);
    EXPECT_EQ(report.located, cloud.size() - too_far);
    EXPECT_EQ(report.turned_away, turned_away);
  }
}

TEST(SurfaceLookup, FindsTheNearestPointOfAClosedSurface) {
  // uv that say where the point found is, in two goes: x and y, then z.
  TriangleMesh mesh = surface("head", 40);
  TriangleMesh heights = mesh;
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Vec3f& p = mesh.position[mesh.face[f][k]];
      mesh.wedge_uv[f][k] = p.head<2>();
      heights.wedge_uv[f][k] = {p.z(), 0};
    }
  }
  RandomMesh random(7);
  SurfelCloud cloud = cloud_at({});
  for (int i = 0; i < 300; ++i) cloud.position.push_back(1.5F * random.point());
  // At vertices and halves of edges several faces are equally near.
  for (std::size_t f = 0; f < 100; ++f) {
    const auto& face = mesh.face[f * 7];
    cloud.position.push_back(mesh.position[face[0]]);
    cloud.position.push_back((mesh.position[face[0]] + mesh.position[face[1]]) / 2);
  }
  cloud.variance.assign(cloud.size(), 100.0F);
  SurfelCloud heights_cloud = cloud;
  const SurfaceLookupReport report = locate_on_mesh(cloud, mesh);
  locate_on_mesh(heights_cloud, heights);
  double sum = 0;
  double largest = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d p = cloud.position[i].cast<double>();
    double least = kInfinity;
    for (std::size_t f = 0; f < mesh.face.size(); ++f) {
      least = std::min(least, (closest_point(p, corners(mesh, f)) - p).norm());
    }
    const Vec3f found(cloud.uv[i].x(), cloud.uv[i].y(), heights_cloud.uv[i].x());
    EXPECT_NEAR((found.cast<double>() - p).norm(), least, 1e-6);
    sum += least;
    largest = std::max(largest, least);
  }
  EXPECT_NEAR(report.mean_distance, sum / static_cast<double>(cloud.size()), 1e-9);
  EXPECT_NEAR(report.largest_distance, largest, 1e-9);
}

TEST(SurfaceLookup, GivesBackWhatTheSamplerGave) {
  SURFEL_REQUIRE_TEST_DATA();
  for (const char* file :
       {"spot/spot_triangulated.obj", "head_scan/lee_perry_smith.obj", "scissors/scissors.obj"}) {
    SCOPED_TRACE(file);
    const TriangleMesh mesh = read_mesh((data_folder() / "textured" / file).string());
    MeshSampleOptions options;
    options.count = 50000;
    const SurfelCloud sampled = sample_mesh(mesh, options);
    SurfelCloud cloud = sampled;
    cloud.uv = {};
    cloud.dpdu = cloud.dpdv = {};
    const SurfaceLookupReport report = locate_on_mesh(cloud, mesh);
    EXPECT_EQ(report.located, cloud.size());
    EXPECT_EQ(report.turned_away, 0U);
    // Positions are rounded to float: next to an edge the neighbour may be nearer.
    const std::size_t forgiven = cloud.size() / 5000;
    std::size_t other_uv = 0;
    std::size_t other_frame = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      other_uv += !((cloud.uv[i] - sampled.uv[i]).norm() < 1e-5);
      other_frame += !cloud.dpdu[i].isApprox(sampled.dpdu[i], 1e-5F) ||
                     !cloud.dpdv[i].isApprox(sampled.dpdv[i], 1e-5F);
    }
    EXPECT_LE(other_uv, forgiven);
    EXPECT_LE(other_frame, forgiven);
  }
}

TEST(SurfaceLookup, TheNormalTellsTheSidesOfASheetApart) {
  for (const float thickness : {0.0F, 0.05F}) {
    TriangleMesh mesh;
    add_square(mesh, 0, true, {0, 0});
    add_square(mesh, -thickness, false, {2, 0});
    // Of the upper side, the lower one, and without normal. Noise put them on the wrong side.
    SurfelCloud cloud =
        cloud_at({{0.3F, 0.6F, -0.04F}, {0.3F, 0.6F, -0.01F}, {0.3F, 0.6F, -0.04F}}, 0.05F);
    cloud.normal = {Vec3f(0, 0.6F, 0.8F), Vec3f(0, 0.6F, -0.8F), Vec3f(0, 0, 0)};
    const SurfaceLookupReport report = locate_on_mesh(cloud, mesh);
    EXPECT_EQ(report.turned_away, 0U);
    EXPECT_LT((cloud.uv[0] - Vec2f(0.3F, 0.6F)).norm(), 1e-6);
    EXPECT_LT((cloud.uv[1] - Vec2f(2.3F, 0.6F)).norm(), 1e-6);
    // Equally near faces: the lowest.
    EXPECT_LT((cloud.uv[2] - Vec2f(thickness > 0 ? 2.3F : 0.3F, 0.6F)).norm(), 1e-6);
  }
}

TEST(SurfaceLookup, TheNormalDoesNotReachFar) {
  TriangleMesh mesh;
  add_square(mesh, 0, false, {0, 0});
  add_square(mesh, 1, true, {2, 0});
  // Distances z and 1 - z of the two: 1 - z > 2 z + 0.28 where z < 0.24.
  SurfelCloud cloud = cloud_at({{0.3F, 0.6F, 0.23F}, {0.3F, 0.6F, 0.25F}}, 0.28F);
  cloud.normal.assign(2, Vec3f(0, 0, 1));
  EXPECT_EQ(locate_on_mesh(cloud, mesh).turned_away, 1U);
  EXPECT_LT((cloud.uv[0] - Vec2f(0.3F, 0.6F)).norm(), 1e-6);
  EXPECT_LT((cloud.uv[1] - Vec2f(2.3F, 0.6F)).norm(), 1e-6);
  // Nor beyond the limit of three standard deviations.
  cloud.variance.assign(2, 0.01F);
  EXPECT_EQ(locate_on_mesh(cloud, mesh).turned_away, 2U);
}

TEST(SurfaceLookup, CornerNormalsSayHowAFaceIsTurned) {
  TriangleMesh mesh;
  add_square(mesh, 0, true, {0, 0});
  add_square(mesh, 0, false, {2, 0});
  const auto all = [](const Vec3f& n) { return std::array<Vec3f, 3>{n, n, n}; };
  const Vec3f up(0, 0, 1);
  const Vec3f down(0, 0, -1);
  mesh.wedge_normal = {all(down), all(down), all(up), all(up)};
  SurfelCloud cloud = cloud_at({{0.3F, 0.6F, 0}});
  cloud.normal = {up};
  locate_on_mesh(cloud, mesh);
  EXPECT_LT((cloud.uv[0] - Vec2f(2.3F, 0.6F)).norm(), 1e-6);
}

TEST(SurfaceLookup, CountsWhatIsTooFar) {
  const TriangleMesh mesh = square();
  const auto located = [&](SurfelCloud cloud) {
    const SurfaceLookupReport report = locate_on_mesh(cloud, mesh);
    EXPECT_EQ(report.located + report.too_far, 4U);
    std::vector<bool> found;
    for (const Vec2f& uv : cloud.uv) found.push_back(uv.allFinite());
    EXPECT_EQ(std::count(found.begin(), found.end(), true),
              static_cast<std::ptrdiff_t>(report.located));
    return found;
  };
  SurfelCloud cloud =
      cloud_at({{0.5F, 0.5F, 0}, {0.5F, 0.5F, 0.29F}, {0.5F, 0.5F, 0.31F}, {0.5F, 3, 1e20F}}, 0.1F);
  EXPECT_EQ(located(cloud), (std::vector{true, true, false, false}));
  cloud.variance = {0.01F, 0.0025F, 0.04F, HUGE_VALF};
  EXPECT_EQ(located(cloud), (std::vector{true, false, true, true}));
  cloud.variance.assign(4, 0.0F);
  EXPECT_EQ(located(cloud), (std::vector{true, false, false, false}));

  // The longer axis counts; a variance that is none is zero.
  cloud.tangent.assign(4, Vec3f(1, 0, 0));
  cloud.variance_u = {0.01F, 0.01F, 0.01F, 0.01F};
  cloud.variance_v = {0.0F, 0.0F, 0.04F, kNan};
  EXPECT_EQ(located(cloud), (std::vector{true, true, true, false}));
  cloud.variance_u[1] = kNan;
  EXPECT_EQ(located(cloud), (std::vector{true, false, true, false}));
}

TEST(SurfaceLookup, SurfelsWithoutPositionGetNoUv) {
  SurfelCloud cloud = cloud_at({{kNan, 0, 0}, {0.5F, 0.25F, 0}, {0, HUGE_VALF, 0}});
  cloud.normal = {Vec3f(0, 0, 1), Vec3f(kNan, 0, 1), Vec3f(0, 0, 1)};
  const SurfaceLookupReport report = locate_on_mesh(cloud, square());
  EXPECT_EQ(report.without_position, 2U);
  EXPECT_EQ(report.located, 1U);
  EXPECT_TRUE(cloud.uv[0].hasNaN() && cloud.uv[2].hasNaN());
  EXPECT_TRUE(cloud.dpdu[0].isZero(0) && cloud.dpdv[2].isZero(0));
  EXPECT_LT((cloud.uv[1] - Vec2f(0.5F, 0.25F)).norm(), 1e-6);
}

TEST(SurfaceLookup, FacesWithoutUvAreaHaveNoDerivatives) {
  TriangleMesh mesh = square();
  for (Vec2f& uv : mesh.wedge_uv[1]) uv.x() = 0.5F;
  SurfelCloud cloud = cloud_at({{0.75F, 0.25F, 0}, {0.25F, 0.75F, 0}});
  EXPECT_EQ(locate_on_mesh(cloud, mesh).flat_uv, 1U);
  EXPECT_TRUE(cloud.dpdu[0].isApprox(Vec3f(1, 0, 0)) && cloud.dpdv[0].isApprox(Vec3f(0, 1, 0)));
  EXPECT_TRUE(cloud.dpdu[1].isZero(0) && cloud.dpdv[1].isZero(0));
  EXPECT_LT((cloud.uv[1] - Vec2f(0.5F, 0.75F)).norm(), 1e-6);
}

TEST(SurfaceLookup, FacesWithoutAreaAreNoSurface) {
  TriangleMesh mesh;
  add_triangle(mesh, {0, 0, 1}, {1, 1, 1}, {0.5F, 0.5F, 1});
  add_triangle(mesh, {0, 0, 1}, {0, 0, 1}, {0, 0, 1});
  mesh.wedge_uv.resize(2, {Vec2f(7, 7), Vec2f(7, 8), Vec2f(8, 7)});
  SurfelCloud cloud = cloud_at({{0.5F, 0.5F, 1}});
  EXPECT_EQ(locate_on_mesh(cloud, mesh).too_far, 1U);
  add_square(mesh, 0, true, {0, 0});
  EXPECT_EQ(locate_on_mesh(cloud, mesh).located, 1U);
  EXPECT_LT((cloud.uv[0] - Vec2f(0.5F, 0.5F)).norm(), 1e-6);
}

TEST(SurfaceLookup, MaterialsAreTheMeshs) {
  TriangleMesh mesh;
  add_square(mesh, 0, true, {0, 0});
  add_square(mesh, 1, true, {0, 0});
  mesh.face_material = {0, 0, 1, 1};
  mesh.material.resize(2);
  const SurfelCloud given = cloud_at({{0.3F, 0.6F, 0.9F}, {0.3F, 0.6F, 0}, {0, 0, 50}});
  SurfelCloud cloud = given;
  locate_on_mesh(cloud, mesh);
  EXPECT_EQ(cloud.material, (Array<std::uint16_t>{1, 0, 0}));
  EXPECT_NO_THROW(cloud.check_columns(""));

  cloud = given;
  cloud.material = {5, 6, 7};
  mesh.face_material.assign(4, 0);
  mesh.material.resize(1);
  locate_on_mesh(cloud, mesh);
  EXPECT_TRUE(cloud.material.empty());
}

TEST(SurfaceLookup, FarFromTheOriginItIsAsPrecise) {
  const TriangleMesh mesh = surface("torus", 100);
  MeshSampleOptions options;
  options.count = 5000;
  SurfelCloud near = sample_mesh(mesh, options);
  SurfelCloud far = near;
  TriangleMesh far_mesh = mesh;
  far_mesh.origin = Vec3d(1e7, -2e7, 3e7);
  far.origin = far_mesh.origin + Vec3d(0.5, 0.25, -0.125);
  for (Vec3f& p : far.position) p -= Vec3f(0.5F, 0.25F, -0.125F);
  locate_on_mesh(near, mesh);
  EXPECT_EQ(locate_on_mesh(far, far_mesh).located, far.size());
  std::size_t other = 0;
  for (std::size_t i = 0; i < near.size(); ++i) {
    other += !((near.uv[i] - far.uv[i]).norm() < 1e-6);
  }
  EXPECT_LE(other, 2U);
}

TEST(SurfaceLookup, IsTheSameForAnyNumberOfThreads) {
  const TriangleMesh mesh = surface("head", 60);
  MeshSampleOptions options;
  options.count = 30000;
  SurfelCloud one = sample_mesh(mesh, options);
  RandomMesh random(3);
  for (std::size_t i = 0; i < one.size(); ++i) {
    one.position[i] += 2 * std::sqrt(one.variance[i]) * random.point();
  }
  SurfelCloud three = one;
  set_thread_count(1);
  const SurfaceLookupReport report_one = locate_on_mesh(one, mesh);
  set_thread_count(3);
  const SurfaceLookupReport report_three = locate_on_mesh(three, mesh);
  set_thread_count(0);
  EXPECT_EQ(report_one.mean_distance, report_three.mean_distance);
  EXPECT_EQ(report_one.largest_distance, report_three.largest_distance);
  const auto same = [](const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  EXPECT_TRUE(same(one.uv, three.uv));
  EXPECT_TRUE(same(one.dpdu, three.dpdu));
  EXPECT_TRUE(same(one.dpdv, three.dpdv));
}

TEST(SurfaceLookup, NoSurfelsAreNoTrouble) {
  SurfelCloud cloud;
  const SurfaceLookupReport report = locate_on_mesh(cloud, square());
  EXPECT_EQ(report.located, 0U);
  EXPECT_EQ(report.mean_distance, 0);
}

template <class F>
ErrorKind kind_of_failure(const F& f) {
  try {
    f();
  } catch (const Error& error) {
    return error.kind();
  }
  ADD_FAILURE() << "no error";
  return ErrorKind::kIo;
}

TEST(SurfaceLookup, RefusesWhatItCannotUse) {
  SurfelCloud cloud = cloud_at({{0, 0, 0}});
  cloud.uv = {Vec2f(3, 4)};
  TriangleMesh mesh = square();
  cloud.variance = {};
  EXPECT_EQ(kind_of_failure([&] { locate_on_mesh(cloud, mesh); }), ErrorKind::kInput);
  cloud.variance = {1.0F};
  mesh.wedge_uv.pop_back();
  EXPECT_EQ(kind_of_failure([&] { locate_on_mesh(cloud, mesh); }), ErrorKind::kInput);
  mesh.wedge_uv = {};
  EXPECT_EQ(kind_of_failure([&] { locate_on_mesh(cloud, mesh); }), ErrorKind::kInput);
  EXPECT_EQ(cloud.uv, (Array<Vec2f>{Vec2f(3, 4)}));
  EXPECT_TRUE(cloud.dpdu.empty());

  locate_on_mesh(cloud, square());
  EXPECT_EQ(cloud.uv, (Array<Vec2f>{Vec2f(0, 0)}));
}

}  // namespace
}  // namespace surfel
