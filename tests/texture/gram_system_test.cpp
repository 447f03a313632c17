#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/gram_system.h>

#include "solve/test_systems.h"

namespace surfel {
namespace {

using test::dense;
using test::eigenvalues;
using test::solve_definite;

enum class Kernels { kIsotropic, kAnisotropic };

/// side x side surfels about a unit apart in the plane z = 0, each displaced by up to 0.3.
SurfelCloud jittered_plane(int side, double kappa, Kernels kernels, unsigned seed = 3) {
  SurfelCloud cloud;
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> uniform(0, 1);
  const auto variance = static_cast<float>(kappa * kappa);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const float dx = 0.6F * uniform(generator) - 0.3F;
      const float dy = 0.6F * uniform(generator) - 0.3F;
      cloud.position.emplace_back(static_cast<float>(x) + dx, static_cast<float>(y) + dy, 0.0F);
      cloud.area.push_back(0.5F + uniform(generator));
      if (kernels == Kernels::kIsotropic) {
        cloud.variance.push_back(variance);
      } else {
        const float ratio = 1 + 2 * uniform(generator);
        const float angle = 2 * std::numbers::pi_v<float> * uniform(generator);
        cloud.variance_u.push_back(variance * ratio);
        cloud.variance_v.push_back(variance / ratio);
        cloud.tangent.emplace_back(std::cos(angle), std::sin(angle), 0.0F);
      }
    }
  }
  cloud.normal.assign(cloud.size(), Vec3f(0, 0, 1));
  return cloud;
}

/// Equation (11) of SS01 for surfels in a plane z = const, written out.
Eigen::MatrixXd planar_gram(const SurfelBasis& basis) {
  const auto n = static_cast<Eigen::Index>(basis.size());
  const auto variance = [&](Eigen::Index k) {
    const auto& f = basis.function[k];
    Eigen::Matrix2d frame;
    frame << f.tangent.x(), f.bitangent.x(), f.tangent.y(), f.bitangent.y();
    return Eigen::Matrix2d(frame * Eigen::Vector2d(f.variance_u, f.variance_v).asDiagonal() *
                           frame.transpose());
  };
  Eigen::MatrixXd gram(n, n);
  for (Eigen::Index k = 0; k < n; ++k) {
    for (Eigen::Index j = 0; j <= k; ++j) {
      const Eigen::Matrix2d sum = variance(k) + variance(j);
      const Vec2d d = (basis.function[k].position - basis.function[j].position).head<2>();
      gram(k, j) = gram(j, k) = basis.function[k].area * basis.function[j].area *
                                std::exp(-d.dot(sum.inverse() * d) / 2) /
                                (2 * std::numbers::pi * std::sqrt(sum.determinant()));
    }
  }
  return gram;
}

/// Surfels on a sphere of radius 1 along a spiral, kernels kappa spacings wide.
SurfelCloud sphere(int count, double kappa) {
  SurfelCloud cloud;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  const double area = 4 * std::numbers::pi / count;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count;
    const double r = std::sqrt(1 - z * z);
    const Vec3d p(r * std::cos(golden * i), r * std::sin(golden * i), z);
    cloud.position.push_back(p.cast<float>());
    cloud.normal.push_back(p.cast<float>());
    cloud.area.push_back(static_cast<float>(area));
    cloud.variance.push_back(static_cast<float>(kappa * kappa * area));
  }
  return cloud;
}

/// Entries between the first `half` surfels of the cloud and the others.
std::size_t crossing_entries(const SurfelBasis& basis, const SymmetricMatrix& lower,
                             std::uint32_t half) {
  const SparseMatrix matrix = both_triangles(lower);
  std::size_t found = 0;
  for (std::size_t row = 0; row < matrix.rows(); ++row) {
    for (std::uint64_t i = matrix.row_begin[row]; i < matrix.row_begin[row + 1]; ++i) {
      if ((basis.surfel[row] < half) != (basis.surfel[matrix.column[i]] < half)) ++found;
    }
  }
  return found;
}

struct PlaneCase {
  double kappa;
  Kernels kernels;
};

class GramPlane : public testing::TestWithParam<PlaneCase> {};

TEST_P(GramPlane, EntriesAndCoefficientsAreThoseOfTheDenseSystem) {
  const SurfelBasis basis = make_basis(jittered_plane(30, GetParam().kappa, GetParam().kernels));
  const GramSystem system = make_gram_system(basis);
  const Eigen::MatrixXd truth = planar_gram(basis);
  const Eigen::MatrixXd gram = dense(system.matrix);
  double error = 0;
  for (Eigen::Index i = 0; i < gram.size(); ++i) {
    const double entry = gram.reshaped()[i];
    if (entry != 0) error = std::max(error, std::abs(entry / truth.reshaped()[i] - 1));
  }
  EXPECT_LT(error, 1e-12);
  EXPECT_LT(system.matrix.entries(), 300 * basis.size());

  Eigen::VectorXd right(basis.size());
  for (Eigen::Index k = 0; k < right.size(); ++k) {
    const auto& f = basis.function[k];
    const bool odd =
        (static_cast<int>(f.position.x() / 5) + static_cast<int>(f.position.y() / 5)) % 2;
    right[k] = odd ? f.area : 0;
  }
  const Eigen::VectorXd exact = solve_definite(truth, right);
  const Eigen::MatrixXd solution = solve_definite(gram, right);
  ASSERT_EQ(solution.rows(), right.rows());
  const double difference = (solution - exact).lpNorm<Eigen::Infinity>();
  EXPECT_LT(difference, 1e-6 * exact.lpNorm<Eigen::Infinity>());
}

INSTANTIATE_TEST_SUITE_P(
    Overlaps, GramPlane,
    testing::Values(PlaneCase{0.5, Kernels::kIsotropic}, PlaneCase{0.7, Kernels::kIsotropic},
                    PlaneCase{0.9, Kernels::kIsotropic}, PlaneCase{0.5, Kernels::kAnisotropic},
                    PlaneCase{0.7, Kernels::kAnisotropic}, PlaneCase{0.9, Kernels::kAnisotropic}));

TEST(GramSystem, ColumnsAscendUpToTheDiagonal) {
  const SurfelBasis basis = make_basis(jittered_plane(20, 0.7, Kernels::kAnisotropic));
  const SymmetricMatrix matrix = make_gram_system(basis).matrix;
  ASSERT_EQ(matrix.rows(), basis.size());
  for (std::size_t row = 0; row < matrix.rows(); ++row) {
    const auto begin = matrix.column.begin() + static_cast<std::ptrdiff_t>(matrix.row_begin[row]);
    const auto end = matrix.column.begin() + static_cast<std::ptrdiff_t>(matrix.row_begin[row + 1]);
    ASSERT_LT(begin, end);
    EXPECT_TRUE(std::is_sorted(begin, end));
    EXPECT_EQ(end[-1], row);
  }
}

TEST(GramSystem, LambdaOfWhatIsLeftOutMakesItDefinite) {
  for (const double kappa : {0.5, 0.8, 1.0, 1.25, 1.5}) {
    GramSystem system =
        make_gram_system(make_basis(jittered_plane(24, kappa, Kernels::kIsotropic)));
    scale_to_unit_diagonal(system.matrix);
    // Beyond that, only what rounding takes.
    add_to_diagonal(system.matrix, system.left_out + 1e-13);
    EXPECT_GT(eigenvalues(dense(system.matrix)).minCoeff(), 0) << kappa;
  }
}

TEST(GramSystem, DefiniteOnASphere) {
  GramSystem system = make_gram_system(make_basis(sphere(600, 0.7)));
  EXPECT_GT(eigenvalues(dense(system.matrix)).minCoeff(), 0);
}

TEST(GramSystem, LeftOutBoundsTheCut) {
  const SurfelBasis basis = make_basis(jittered_plane(30, 0.7, Kernels::kIsotropic));
  const GramSystem system = make_gram_system(basis);
  const Eigen::MatrixXd cut = planar_gram(basis) - dense(system.matrix);
  EXPECT_LT(eigenvalues(cut).cwiseAbs().maxCoeff(),
            3 * system.left_out * planar_gram(basis).diagonal().maxCoeff());
}

TEST(GramSystem, SheetsAndEdgesDoNotCouple) {
  const SurfelCloud sheet = jittered_plane(12, 0.7, Kernels::kIsotropic);
  const auto half = static_cast<std::uint32_t>(sheet.size());
  const auto crossing = [&](const Vec3f& normal, float height) {
    SurfelCloud both = sheet;
    for (std::uint32_t k = 0; k < half; ++k) {
      both.position.push_back(sheet.position[k] + Vec3f(0, 0, height));
      both.normal.push_back(normal);
      both.variance.push_back(sheet.variance[k]);
      both.area.push_back(sheet.area[k]);
    }
    const SurfelBasis basis = make_basis(both);
    const GramSystem system = make_gram_system(basis);
    return crossing_entries(basis, system.matrix, half);
  };
  EXPECT_EQ(crossing(Vec3f(0, 0, -1), 0.01F), 0U);             // The other side.
  EXPECT_EQ(crossing(Vec3f(1, 0, 0), 0.01F), 0U);              // An edge.
  EXPECT_EQ(crossing(Vec3f(0, 0, 1), 0.71F), 0U);              // A sheet above, further than sigma.
  EXPECT_GT(crossing(Vec3f(0, 0, 1), 0.1F), 20U * half);       // Noise.
  EXPECT_GT(crossing(Vec3f(0, 0.5F, 0.8F), 0.0F), 1U * half);  // A bend.
}

/// Coefficients of a step, by surfel of the cloud.
Eigen::VectorXd step_coefficients(const SurfelCloud& cloud, double lambda) {
  const SurfelBasis basis = make_basis(cloud);
  GramSystem system = make_gram_system(basis);
  const Array<double> scale = scale_to_unit_diagonal(system.matrix);
  add_to_diagonal(system.matrix, lambda);
  const auto n = static_cast<Eigen::Index>(basis.size());
  Eigen::VectorXd right(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const auto& f = basis.function[k];
    right[k] = f.position.x() < 8 ? 0 : scale[k] * f.area;
  }
  const Eigen::VectorXd solution = solve_definite(dense(system.matrix), right);
  Eigen::VectorXd result(n);
  for (Eigen::Index k = 0; k < n; ++k) result[basis.surfel[k]] = solution[k] * scale[k];
  return result;
}

TEST(GramSystem, DuplicatesShareTheCoefficient) {
  const SurfelCloud cloud = jittered_plane(16, 0.7, Kernels::kIsotropic);
  SurfelCloud twice = cloud;
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    twice.position.push_back(cloud.position[k]);
    twice.normal.push_back(cloud.normal[k]);
    twice.variance.push_back(cloud.variance[k]);
    twice.area.push_back(cloud.area[k]);
  }
  // (2 R + lambda) w = c for each of the two.
  const Eigen::VectorXd half = step_coefficients(cloud, 0.5e-2) / 2;
  const Eigen::VectorXd both = step_coefficients(twice, 1e-2);
  // Twice as dense, the surfels reach further; with either reach coefficients are so accurate.
  const double bound = 1e-6 * half.lpNorm<Eigen::Infinity>();
  EXPECT_LT((both.head(half.size()) - half).lpNorm<Eigen::Infinity>(), bound);
  EXPECT_LT((both.tail(half.size()) - half).lpNorm<Eigen::Infinity>(), bound);
}

TEST(GramSystem, RotatedCloudHasTheSameEntries) {
  for (const Kernels kernels : {Kernels::kIsotropic, Kernels::kAnisotropic}) {
    SurfelBasis basis = make_basis(jittered_plane(15, 0.7, kernels));
    std::mt19937 generator(5);
    std::uniform_real_distribution<double> tilt(-0.2, 0.2);
    for (auto& f : basis.function) {  // Bent at random.
      const Eigen::Matrix3d turn = (Eigen::AngleAxisd(tilt(generator), Vec3d::UnitX()) *
                                    Eigen::AngleAxisd(tilt(generator), Vec3d::UnitY()))
                                       .toRotationMatrix();
      for (Vec3d* axis : {&f.tangent, &f.bitangent, &f.normal}) *axis = turn * *axis;
    }
    SurfelBasis rotated = basis;
    const Eigen::Matrix3d rotation =
        Eigen::AngleAxisd(1.1, Vec3d(1, -2, 0.5).normalized()).toRotationMatrix();
    for (auto& f : rotated.function) {
      for (Vec3d* v : {&f.position, &f.tangent, &f.bitangent, &f.normal}) *v = rotation * *v;
    }
    const SymmetricMatrix before = make_gram_system(basis).matrix;
    const SymmetricMatrix after = make_gram_system(rotated).matrix;
    ASSERT_TRUE(before.column == after.column);
    for (std::size_t i = 0; i < before.value.size(); ++i) {
      EXPECT_NEAR(after.value[i] / before.value[i], 1, 1e-9);
    }
  }
}

TEST(GramSystem, DensityJumpsKeepTheWorkAndTheCondition) {
  SurfelCloud cloud = jittered_plane(20, 0.6, Kernels::kIsotropic);
  cloud.area.assign(cloud.size(), 1.0F);
  SurfelCloud fine = cloud;
  for (std::size_t k = 0; k < fine.size(); ++k) {
    cloud.position.emplace_back(fine.position[k] * 0.01F + Vec3f(20, 10, 0));
    cloud.normal.push_back(fine.normal[k]);
    cloud.variance.push_back(fine.variance[k] * 1e-4F);
    cloud.area.push_back(1e-4F);
  }
  const SurfelBasis basis = make_basis(cloud);
  GramSystem system = make_gram_system(basis);
  const Array<double> scale = scale_to_unit_diagonal(system.matrix);
  for (std::size_t k = 0; k < basis.size(); ++k) EXPECT_GT(scale[k], 0);
  const Eigen::MatrixXd scaled = dense(system.matrix);
  EXPECT_LT((scaled.diagonal().array() - 1).abs().maxCoeff(), 1e-14);
  const Eigen::VectorXd spectrum = eigenvalues(scaled);
  EXPECT_GT(spectrum.minCoeff(), 0);
  EXPECT_LT(spectrum.maxCoeff() / spectrum.minCoeff(), 1e5);
}

TEST(GramSystem, RowSumsAndDiagonal) {
  const SurfelBasis basis = make_basis(jittered_plane(15, 0.6, Kernels::kIsotropic));
  GramSystem system = make_gram_system(basis);
  const Eigen::MatrixXd before = dense(system.matrix);
  const Array<double> sums = row_sums(system.matrix);
  for (std::size_t k = 0; k < sums.size(); ++k) {
    EXPECT_NEAR(sums[k], before.row(static_cast<Eigen::Index>(k)).sum(), 1e-12);
  }
  add_to_diagonal(system.matrix, 0.5);
  Eigen::MatrixXd expected = before;
  expected.diagonal().array() += 0.5 * before.diagonal().mean();
  EXPECT_LT((dense(system.matrix) - expected).cwiseAbs().maxCoeff(), 1e-14);
}

TEST(GramSystem, ConstantIsExactForRowSums) {
  const SurfelBasis basis = make_basis(jittered_plane(20, 0.6, Kernels::kIsotropic));
  const GramSystem system = make_gram_system(basis);
  const Array<double> sums = row_sums(system.matrix);
  const Eigen::Map<const Eigen::VectorXd> right(sums.data(),
                                                static_cast<Eigen::Index>(sums.size()));
  const Eigen::VectorXd solution = solve_definite(dense(system.matrix), right);
  EXPECT_LT((solution.array() - 1).abs().maxCoeff(), 1e-10);
}

TEST(GramSystem, SameBytesForAnyNumberOfThreads) {
  const SurfelBasis basis = make_basis(jittered_plane(60, 0.7, Kernels::kAnisotropic));
  const int threads = thread_count();
  set_thread_count(1);
  const SymmetricMatrix one = make_gram_system(basis).matrix;
  set_thread_count(3);
  const SymmetricMatrix three = make_gram_system(basis).matrix;
  set_thread_count(threads);
  EXPECT_TRUE(one.row_begin == three.row_begin);
  EXPECT_TRUE(one.column == three.column);
  EXPECT_TRUE(one.value == three.value);
}

TEST(GramSystem, NoneOneAndIsolated) {
  EXPECT_EQ(make_gram_system(SurfelBasis()).matrix.rows(), 0U);
  GramSystem empty = make_gram_system(SurfelBasis());
  add_to_diagonal(empty.matrix, 1);
  EXPECT_TRUE(scale_to_unit_diagonal(empty.matrix).empty());

  SurfelCloud cloud = jittered_plane(1, 0.7, Kernels::kIsotropic);
  const SurfelBasis one = make_basis(cloud);
  const double area = one.function[0].area;
  const SymmetricMatrix single = make_gram_system(one).matrix;
  ASSERT_EQ(single.entries(), 1U);
  EXPECT_NEAR(single.value[0], area * area / (4 * std::numbers::pi * one.function[0].variance_u),
              1e-15);

  cloud.position.emplace_back(1e6F, 0.0F, 0.0F);
  cloud.normal.emplace_back(0.0F, 0.0F, 1.0F);
  cloud.variance.push_back(1);
  cloud.area.push_back(1);
  EXPECT_EQ(make_gram_system(make_basis(cloud)).matrix.entries(), 2U);
}

}  // namespace
}  // namespace surfel
