// Ericson 2005, "Real-Time Collision Detection", section 5.1.5 (closest point on a triangle).

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/morton.h>
#include <surfel/base/parallel.h>
#include <surfel/base/stage_timer.h>
#include <surfel/sample/mesh_face.h>
#include <surfel/scene/surfel_variance.h>
#include <surfel/texture/surface_lookup.h>

namespace surfel {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kFloatEpsilon = std::numeric_limits<float>::epsilon();
constexpr std::uint32_t kNoFace = std::numeric_limits<std::uint32_t>::max();
constexpr std::size_t kLookupGrain = 1 << 12;

/// A surfel lies on the mesh where it is at most this many of its (larger) standard deviations from
/// it, beyond the coordinates' rounding: 99.7 % of normal noise as wide as the surfel.
constexpr double kMostDeviations = 3;

Vec3d weighted_sum(const FaceCorners& corner, const Vec3d& weight) {
  return weight[0] * corner[0] + weight[1] * corner[1] + weight[2] * corner[2];
}

/// Barycentric coordinates of the triangle's point nearest to p. Every division is by more than its
/// dividend, so that edges too short to be told from none do no harm.
Vec3d closest_in_triangle(const Vec3d& p, const FaceCorners& t) {
  const Vec3d ab = t[1] - t[0];
  const Vec3d ac = t[2] - t[0];
  const Vec3d ap = p - t[0];
  const double d1 = ab.dot(ap);
  const double d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return {1, 0, 0};

  const Vec3d bp = p - t[1];
  const double d3 = ab.dot(bp);
  const double d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return {0, 1, 0};

  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 > 0 && d3 <= 0) {
    const double b = d1 / (d1 - d3);
    return {1 - b, b, 0};
  }
  const Vec3d cp = p - t[2];
  const double d5 = ab.dot(cp);
  const double d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return {0, 0, 1};

  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 > 0 && d6 <= 0) {
    const double c = d2 / (d2 - d6);
    return {1 - c, 0, c};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 > d3 && d5 >= d6) {
    const double c = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return {0, 1 - c, c};
  }
  const double sum = va + vb + vc;
  return {1 - vb / sum - vc / sum, vb / sum, vc / sum};
}

struct Query {
  Vec3d position;            ///< Place in the mesh's coordinates.
  Vec3d normal{0, 0, 0};     ///< Zero: unknown.
  double limit = kInfinity;  ///< Faces further away are not there.
  double turned_away = 0;  ///< The length that is added to twice the distance of faces turned away.
};

struct SurfacePoint {
  std::uint32_t face = kNoFace;
  Vec3d barycentric{0, 0, 0};
  double distance2 = kInfinity;
  double cost2 = kInfinity;  ///< Square of the distance, or of the length that it counts as.
  bool turned_away = false;
};

/// Bounding volume hierarchy over a mesh's faces: a complete 4-ary tree of boxes, split at medians,
/// whose leaves hold equal shares of the faces. Node i has the children 4 i + 1 to 4 i + 4, so that
/// there are no links. It is no BoxTree (base/box_tree.h), as a node holds its children's boxes
/// side by side, in the lanes of a register, and the order of the faces is that of the splits.
class FaceTree {
 public:
  explicit FaceTree(const TriangleMesh& mesh) : mesh_(mesh) {
    Array<Center> centers = face_centers();
    face_count_ = centers.size();
    constexpr std::size_t kMostFacesInLeaf = 4;  // A node has as many children.
    for (levels_ = 1; (kMostFacesInLeaf << (2 * levels_)) < face_count_;) ++levels_;
    node_.resize(first_of_level(levels_));
    for (int level = 0; level < levels_; ++level) {
      parallel_for(std::size_t{1} << (2 * level), 1U << level,
                   [&](std::size_t begin, std::size_t end, int) {
                     for (std::size_t i = begin; i < end; ++i) split(level, i, centers);
                   });
    }
    face_.resize(face_count_);
    for (std::size_t i = 0; i < face_count_; ++i) face_[i] = centers[i].face;
    for (int level = levels_ - 1; level >= 0; --level) {
      parallel_for(std::size_t{1} << (2 * level), kLookupGrain,
                   [&](std::size_t begin, std::size_t end, int) {
                     for (std::size_t i = begin; i < end; ++i) bound(level, i);
                   });
    }
  }

  /// Largest coordinate of the mesh, by which its rounding is measured.
  double largest_coordinate() const { return largest_coordinate_; }

  /// The nearest face, as the query's rules have it.
  /// \param guess  a face that may be near, or kNoFace: saves time and changes nothing.
  SurfacePoint nearest(const Query& query, std::uint32_t guess) const {
    SurfacePoint best;
    // The boxes' distances are worked out in float; their rounding must not hide a face.
    const double slack =
        8 * kFloatEpsilon * (largest_coordinate_ + query.position.cwiseAbs().maxCoeff());
    float bound2 = 0;
    const auto set_bound = [&] {
      const double bound = std::min(query.limit, std::sqrt(best.cost2)) + slack;
      bound2 = static_cast<float>(bound * bound);
    };
    if (guess != kNoFace) try_face(query, guess, best);
    set_bound();

    const Vec3f p = query.position.cast<float>();
    const std::size_t first_leaf = node_.size();
    struct Open {
      std::size_t node;
      float distance2;
    };
    std::array<Open, 64> open;  // Three siblings wait on each of at most 16 levels.
    std::size_t open_count = 0;
    open[open_count++] = {0, 0};
    while (open_count > 0) {
      const Open at = open[--open_count];
      if (at.distance2 > bound2) continue;
      if (at.node >= first_leaf) {
        const double before = best.cost2;
        const std::size_t leaf = at.node - first_leaf;
        const std::size_t end = range_begin(levels_, leaf + 1);
        for (std::size_t i = range_begin(levels_, leaf); i < end; ++i) {
          try_face(query, face_[i], best);
        }
        if (best.cost2 < before) set_bound();
        continue;
      }
      const Eigen::Array4f distance2 = node_[at.node].distance2(p);
      const std::size_t first_open = open_count;
      for (int k = 0; k < 4; ++k) {
        if (distance2[k] > bound2) continue;
        // The nearest is to be taken next, so it goes last.
        std::size_t place = open_count++;
        for (; place > first_open && open[place - 1].distance2 < distance2[k]; --place) {
          open[place] = open[place - 1];
        }
        open[place] = {4 * at.node + 1 + static_cast<std::size_t>(k), distance2[k]};
      }
    }
    return best;
  }

 private:
  struct Center {
    Vec3f position;
    std::uint32_t face;
  };
  /// Boxes of four children, one in each lane. The box of a child without faces is infinitely far.
  struct Node {
    std::array<Eigen::Array4f, 3> min;
    std::array<Eigen::Array4f, 3> max;

    Eigen::Array4f distance2(const Vec3f& p) const {
      Eigen::Array4f sum = Eigen::Array4f::Zero();
      for (int axis = 0; axis < 3; ++axis) {
        const Eigen::Array4f d = (min[axis] - p[axis]).max(p[axis] - max[axis]).max(0.0F);
        sum += d * d;
      }
      return sum;
    }
  };

  /// Centres of the faces that have an area. Sets the largest coordinate as well.
  Array<Center> face_centers() {
    Array<Center> centers;
    centers.reserve(mesh_.face.size());
    for (std::uint32_t face = 0; face < mesh_.face.size(); ++face) {
      const FaceCorners corner = face_corners(mesh_, face);
      if (!(area_vector(corner).squaredNorm() > 0)) continue;
      const Vec3d low = corner[0].cwiseMin(corner[1]).cwiseMin(corner[2]);
      const Vec3d high = corner[0].cwiseMax(corner[1]).cwiseMax(corner[2]);
      largest_coordinate_ =
          std::max(largest_coordinate_, low.cwiseAbs().cwiseMax(high.cwiseAbs()).maxCoeff());
      centers.push_back({((low + high) / 2).cast<float>(), face});
    }
    return centers;
  }

  static std::size_t first_of_level(int level) { return ((std::size_t{1} << (2 * level)) - 1) / 3; }

  /// The first face of a level's node; its last one is before the first of the next node.
  std::size_t range_begin(int level, std::size_t index) const {
    return (face_count_ * index) >> (2 * level);
  }

  /// Sorts a node's faces into its four children.
  void split(int level, std::size_t index, Array<Center>& centers) const {
    const auto at = [&](std::size_t child) { return range_begin(level + 1, 4 * index + child); };
    split(centers, at(0), at(2), at(4));
    split(centers, at(0), at(1), at(2));
    split(centers, at(2), at(3), at(4));
  }

  static void split(Array<Center>& centers, std::size_t begin, std::size_t middle,
                    std::size_t end) {
    if (end - begin < 2) return;
    Vec3f low = centers[begin].position;
    Vec3f high = low;
    for (std::size_t i = begin; i < end; ++i) {
      low = low.cwiseMin(centers[i].position);
      high = high.cwiseMax(centers[i].position);
    }
    int axis = 0;
    (high - low).maxCoeff(&axis);
    const auto first = centers.begin();
    using Difference = Array<Center>::difference_type;
    std::nth_element(
        first + static_cast<Difference>(begin), first + static_cast<Difference>(middle),
        first + static_cast<Difference>(end),
        [axis](const Center& a, const Center& b) { return a.position[axis] < b.position[axis]; });
  }

  /// Fills in a node whose children are filled in.
  void bound(int level, std::size_t index) {
    Node& node = node_[first_of_level(level) + index];
    constexpr float kFar = std::numeric_limits<float>::infinity();
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t child = 4 * index + k;
      Vec3f low = Vec3f::Constant(kFar);
      Vec3f high = -low;
      if (level + 1 == levels_) {
        for (std::size_t i = range_begin(levels_, child); i < range_begin(levels_, child + 1);
             ++i) {
          for (const std::uint32_t vertex : mesh_.face[face_[i]]) {
            low = low.cwiseMin(mesh_.position[vertex]);
            high = high.cwiseMax(mesh_.position[vertex]);
          }
        }
      } else {
        const Node& below = node_[first_of_level(level + 1) + child];
        for (int axis = 0; axis < 3; ++axis) {
          low[axis] = below.min[axis].minCoeff();
          high[axis] = below.max[axis].maxCoeff();
        }
      }
      for (int axis = 0; axis < 3; ++axis) {
        node.min[axis][static_cast<int>(k)] = low[axis];
        node.max[axis][static_cast<int>(k)] = high[axis];
      }
    }
  }

  /// Makes this face `best` if it is better.
  void try_face(const Query& query, std::uint32_t face, SurfacePoint& best) const {
    const FaceCorners corner = face_corners(mesh_, face);
    const Vec3d barycentric = closest_in_triangle(query.position, corner);
    const double distance2 = (weighted_sum(corner, barycentric) - query.position).squaredNorm();
    if (!(distance2 <= best.cost2 && distance2 <= query.limit * query.limit)) return;
    const bool turned_away = query.normal.dot(facing(face, corner)) < 0;
    double cost2 = distance2;
    if (turned_away) {
      const double cost = 2 * std::sqrt(distance2) + query.turned_away;
      cost2 = cost * cost;
    }
    if (std::pair(cost2, face) < std::pair(best.cost2, best.face)) {
      best = {face, barycentric, distance2, cost2, turned_away};
    }
  }

  /// Direction, not unit, that the face's front looks to.
  Vec3d facing(std::uint32_t face, const FaceCorners& corner) const {
    if (!mesh_.wedge_normal.empty()) {
      const auto& normal = mesh_.wedge_normal[face];
      const Vec3f sum = normal[0] + normal[1] + normal[2];
      if (sum.squaredNorm() > 0) return sum.cast<double>();
    }
    return area_vector(corner);
  }

  const TriangleMesh& mesh_;
  double largest_coordinate_ = 0;
  std::size_t face_count_ = 0;
  int levels_ = 0;             ///< Levels of nodes; the leaves are the level below.
  Array<Node> node_;           ///< Nodes level by level.
  Array<std::uint32_t> face_;  ///< Faces in the order of the leaves.
};

/// Standard deviation along the longer axis; 0 where there is none.
double deviation(const SurfelCloud& cloud, std::size_t i) {
  float variance = 0;
  if (cloud.anisotropic()) {
    variance = std::max(cloud.variance_u[i], cloud.variance_v[i]);
  } else if (!cloud.variance.empty()) {
    variance = cloud.variance[i];
  }
  return variance > 0 ? std::sqrt(static_cast<double>(variance)) : 0;
}

/// The query for a surfel's place on the mesh.
Query query_of(const SurfelCloud& cloud, std::size_t i, const Vec3d& to_mesh,
               const FaceTree& tree) {
  const Vec3d position = cloud.position[i].cast<double>();
  const double sigma = deviation(cloud, i);
  // Surfels on the mesh need not be further from it than both sides' rounding.
  const double rounding =
      kFloatEpsilon * (position.cwiseAbs().maxCoeff() + tree.largest_coordinate());
  Query query;
  query.position = to_mesh + position;
  query.limit = rounding + kMostDeviations * sigma;
  query.turned_away = sigma + rounding;
  if (!cloud.normal.empty() && cloud.normal[i].allFinite()) {
    query.normal = cloud.normal[i].cast<double>();
  }
  return query;
}

/// Finds and writes surfels one by one. The columns are its own until all are written.
class Lookup {
 public:
  Lookup(const SurfelCloud& cloud, const TriangleMesh& mesh, const FaceTree& tree)
      : cloud_(cloud), mesh_(mesh), tree_(tree), to_mesh_(cloud.origin - mesh.origin) {
    uv_.resize(cloud.size());
    dpdu_.resize(cloud.size());
    dpdv_.resize(cloud.size());
    if (mesh.material.size() > 1 && !mesh.face_material.empty()) material_.resize(cloud.size());
  }

  /// The report's distances are sums. `guess` is a face that may be near, and becomes the one
  /// found.
  void locate(std::size_t i, std::uint32_t& guess, SurfaceLookupReport& report) {
    uv_[i] = {kNan, kNan};
    dpdu_[i] = dpdv_[i] = Vec3f::Zero();
    if (!material_.empty()) material_[i] = 0;
    if (!cloud_.position[i].allFinite()) {
      ++report.without_position;
      return;
    }
    const SurfacePoint found = tree_.nearest(query_of(cloud_, i, to_mesh_, tree_), guess);
    if (found.face == kNoFace) {
      ++report.too_far;
      return;
    }
    guess = found.face;
    ++report.located;
    report.turned_away += found.turned_away;
    const double distance = std::sqrt(found.distance2);
    report.mean_distance += distance;
    report.largest_distance = std::max(report.largest_distance, distance);

    Vec2d uv = Vec2d::Zero();
    for (int k = 0; k < 3; ++k) {
      uv += found.barycentric[k] * mesh_.wedge_uv[found.face][k].cast<double>();
    }
    const UvFrame frame = uv_frame(face_corners(mesh_, found.face), mesh_.wedge_uv[found.face]);
    report.flat_uv += frame.dpdu.isZero(0) && frame.dpdv.isZero(0);
    uv_[i] = uv.cast<float>();
    dpdu_[i] = frame.dpdu.cast<float>();
    dpdv_[i] = frame.dpdv.cast<float>();
    if (!material_.empty()) material_[i] = mesh_.face_material[found.face];
  }

  void move_columns_to(SurfelCloud& cloud) {
    cloud.uv = std::move(uv_);
    cloud.dpdu = std::move(dpdu_);
    cloud.dpdv = std::move(dpdv_);
    cloud.material = std::move(material_);
  }

 private:
  const SurfelCloud& cloud_;
  const TriangleMesh& mesh_;
  const FaceTree& tree_;
  Vec3d to_mesh_;
  Array<Vec2f> uv_;
  Array<Vec3f> dpdu_;
  Array<Vec3f> dpdv_;
  Array<std::uint16_t> material_;
};

void check_variance(const SurfelCloud& cloud) {
  if (!cloud.empty() && !has_variance(cloud)) {
    throw_input("",
                "the surfels have no variance to say how far from the mesh they may lie; "
                "surfel-estimate writes one");
  }
}

void check_input(const SurfelCloud& cloud, const TriangleMesh& mesh, const std::string& name) {
  if (mesh.wedge_uv.empty()) {
    throw_input(name, "the mesh has no texture coordinates to give to the surfels");
  }
  mesh.check_columns(name);
  check_variance(cloud);
}

}  // namespace

MeshProximity mesh_proximity(const SurfelCloud& cloud, const TriangleMesh& mesh, std::size_t most) {
  check_variance(cloud);
  const std::size_t count = std::min(cloud.size(), most);
  const FaceTree tree(mesh);
  const Vec3d to_mesh = cloud.origin - mesh.origin;
  struct Sum {
    std::size_t near = 0;
    std::size_t far = 0;
    double least = kInfinity;
  };
  PerWorker<Sum> sums;
  constexpr std::size_t kGrain = 1 << 8;
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end, int worker) {
    Sum& sum = sums[worker];
    for (std::size_t k = begin; k < end; ++k) {
      const std::size_t i = k * cloud.size() / count;
      if (!cloud.position[i].allFinite()) continue;
      Query query = query_of(cloud, i, to_mesh, tree);
      const double limit = std::exchange(query.limit, kInfinity);
      query.normal = Vec3d::Zero();
      const SurfacePoint found = tree.nearest(query, kNoFace);
      const double distance = std::sqrt(found.distance2);
      (distance <= limit ? sum.near : sum.far) += 1;
      sum.least = std::min(sum.least, distance);
    }
  });
  Sum all;
  sums.for_each([&](const Sum& sum) {
    all.near += sum.near;
    all.far += sum.far;
    all.least = std::min(all.least, sum.least);
  });
  return {all.near, all.far, all.near + all.far > 0 ? all.least : 0};
}

SurfaceLookupReport locate_on_mesh(SurfelCloud& cloud, const TriangleMesh& mesh,
                                   const std::string& name) {
  check_input(cloud, mesh, name);
  SurfaceLookupReport report;
  StageTimer timer(report.times);
  const FaceTree tree(mesh);
  timer.end("face tree");

  // Along the curve, a surfel's face is a good guess of the next one's.
  const Array<std::uint32_t> order = morton_order(cloud.position);
  timer.end("order");

  Lookup lookup(cloud, mesh, tree);
  std::vector<SurfaceLookupReport> parts((order.size() + kLookupGrain - 1) / kLookupGrain);
  parallel_for(order.size(), kLookupGrain, [&](std::size_t begin, std::size_t end, int) {
    std::uint32_t guess = kNoFace;
    for (std::size_t i = begin; i < end; ++i) {
      lookup.locate(order[i], guess, parts[begin / kLookupGrain]);
    }
  });
  lookup.move_columns_to(cloud);
  for (const SurfaceLookupReport& part : parts) {
    report.located += part.located;
    report.too_far += part.too_far;
    report.without_position += part.without_position;
    report.flat_uv += part.flat_uv;
    report.turned_away += part.turned_away;
    report.mean_distance += part.mean_distance;
    report.largest_distance = std::max(report.largest_distance, part.largest_distance);
  }
  if (report.located > 0) report.mean_distance /= static_cast<double>(report.located);
  timer.end("lookup");
  return report;
}

}  // namespace surfel
