#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <random>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/render_system.h>

#include "solve/test_systems.h"
#include "support/dense_algebra.h"

namespace surfel {
namespace {

using test::dense;
using test::eigenvalues;
using test::product;
using test::solve_definite;

SurfelBasis::Function make_function(const Vec3d& position, const Vec3d& normal, double sigma_u,
                                    double sigma_v, double turn = 0, double area = 1) {
  const Vec3d n = normal.normalized();
  const Vec3d t = Eigen::AngleAxisd(turn, n) * n.unitOrthogonal();
  return {position, t, n.cross(t), n, sigma_u * sigma_u, sigma_v * sigma_v, area};
}

SurfelBasis basis_of(std::initializer_list<SurfelBasis::Function> functions) {
  SurfelBasis basis;
  basis.function.assign(functions);
  return basis;
}

/// Plane z = 0, spacing 1, side x side functions.
SurfelBasis flat_grid(int side, double sigma, double jitter = 0.33) {
  SurfelBasis basis;
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> uniform(-jitter, jitter);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const double px = x + uniform(generator);
      const double py = y + uniform(generator);
      basis.function.push_back(make_function({px, py, 0}, {0, 0, 1}, sigma, sigma));
    }
  }
  return basis;
}

/// A bumpy surface with ellipses of all directions, whose sizes differ by up to 30 : 1.
SurfelBasis bumpy_surface(std::size_t count) {
  SurfelBasis basis;
  std::mt19937 generator(2);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (std::size_t k = 0; k < count; ++k) {
    const double x = 12 * uniform(generator);
    const double y = 12 * uniform(generator);
    const Vec3d position(x, y, 0.8 * std::sin(x) * std::cos(y));
    const Vec3d normal(-0.8 * std::cos(x) * std::cos(y), 0.8 * std::sin(x) * std::sin(y), 1);
    const double size = std::pow(30.0, -uniform(generator));
    const double aspect = 1 + 2 * uniform(generator);
    basis.function.push_back(
        make_function(position, normal, aspect * size, size, 6 * uniform(generator), size * size));
  }
  return basis;
}

Eigen::MatrixXd dense(const SparseMatrix& matrix) {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(matrix.rows()),
                                                 static_cast<Eigen::Index>(matrix.columns));
  for (std::size_t row = 0; row < matrix.rows(); ++row) {
    for (std::size_t e = matrix.row_begin[row]; e < matrix.row_begin[row + 1]; ++e) {
      const bool ascending = e == matrix.row_begin[row] || matrix.column[e - 1] < matrix.column[e];
      EXPECT_TRUE(ascending);
      result(static_cast<Eigen::Index>(row), matrix.column[e]) = matrix.value[e];
    }
  }
  return result;
}

/// Does a half-plane of a function cut off the place at this offset from its position?
bool cut_off(const SurfelBasis& basis, std::size_t k, const Vec3d& offset) {
  if (basis.cut.empty()) return false;
  const SurfelBasis::Function& f = basis.function[k];
  const double rounding = 1e-3 * std::sqrt(std::max(f.variance_u, f.variance_v));
  const Vec2d flat(offset.dot(f.tangent), offset.dot(f.bitangent));
  for (const SurfelBasis::Cut& line : basis.cut[k]) {
    if (line.direction.dot(flat) > line.distance + rounding) return true;
  }
  return false;
}

/// Half-planes, one for most functions and two for some; some cut off the centre.
void cut_functions(SurfelBasis& basis) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (const SurfelBasis::Function& f : basis.function) {
    std::array<SurfelBasis::Cut, 2> cut{SurfelBasis::Cut{{0, 0}, 0}, SurfelBasis::Cut{{0, 0}, 0}};
    for (SurfelBasis::Cut& line : cut) {
      if (uniform(generator) < 0.4) continue;
      const double angle = 7 * uniform(generator);
      line = {{std::cos(angle), std::sin(angle)},
              (1.5 * uniform(generator) - 0.2) * std::sqrt(f.variance_u)};
    }
    basis.cut.push_back(cut);
  }
}

/// The definition, point by point and function by function.
Eigen::MatrixXd brute_force(const SurfelBasis& basis, const Quadrature& points, double cutoff) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(points.size()),
                                            static_cast<Eigen::Index>(basis.size()));
  for (std::size_t i = 0; i < basis.size(); ++i) {
    const SurfelBasis::Function& owner = basis.function[i];
    double radius = 0;
    for (std::size_t q = points.begin[i]; q < points.begin[i + 1]; ++q) {
      radius = std::max(radius, points.offset[q].cast<double>().norm());
    }
    for (std::size_t q = points.begin[i]; q < points.begin[i + 1]; ++q) {
      const Vec2d offset = points.offset[q].cast<double>();
      const Vec3d p = owner.position + offset.x() * owner.tangent + offset.y() * owner.bitangent;
      const auto row = static_cast<Eigen::Index>(q);
      if (cut_off(basis, i, p - owner.position)) continue;
      for (std::size_t k = 0; k < basis.size(); ++k) {
        const SurfelBasis::Function& f = basis.function[k];
        const double reach = std::sqrt(2 * cutoff * std::max(f.variance_u, f.variance_v));
        const double cosine = f.normal.dot(owner.normal);
        if (cosine < 0.5) continue;
        if ((owner.position - f.position).norm() > radius + std::sqrt(2.0) * reach) continue;
        const double depth = f.normal.dot(f.position - p) / cosine;
        if (std::abs(depth) > reach) continue;
        const Vec3d u = p + depth * owner.normal - f.position;
        const double beta = 0.5 * (std::pow(u.dot(f.tangent), 2) / f.variance_u +
                                   std::pow(u.dot(f.bitangent), 2) / f.variance_v);
        if (beta >= cutoff || cut_off(basis, k, u)) continue;
        const double determinant = f.variance_u * f.variance_v;
        A(row, static_cast<Eigen::Index>(k)) =
            f.area * std::exp(-beta) / (2 * std::numbers::pi * std::sqrt(determinant));
      }
      const double sum = A.row(row).sum();
      if (sum > 0) A.row(row) /= sum;
    }
  }
  return A;
}

Array<Channels> constant(std::size_t count, double value) {
  return Array<Channels>(count, Channels::Constant(value));
}

Array<Channels> noise(std::size_t count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  Array<Channels> values(count);
  for (Channels& value : values) {
    for (double& channel : value) channel = uniform(generator);
  }
  return values;
}

Array<Channels> solve(const RenderSystem& system, const Array<Channels>& right_side) {
  const Eigen::MatrixX4d w = solve_definite(dense(system.normal_matrix), dense(right_side));
  Array<Channels> result(right_side.size());
  for (std::size_t k = 0; k < result.size(); ++k) {
    result[k] = w.row(static_cast<Eigen::Index>(k)).transpose().array();
  }
  return result;
}

/// Points that no function reaches have no residual.
void expect_bounded(const RenderSystem& system, const Array<Channels>& f,
                    const Array<Channels>& w_0) {
  const Array<Channels> w = solve(system, system.right_side(f, w_0));
  const Channels change = (dense(w) - dense(w_0)).colwise().squaredNorm().transpose().array();
  const Channels bound = (system.near.residual2(w_0, f) + system.pull2(w_0, w_0)) / system.lambda;
  EXPECT_TRUE(dense(w).allFinite());
  EXPECT_TRUE((change <= bound + 1e-12).all()) << change.transpose() << " " << bound.transpose();
}

template <class T>
bool same_bytes(const Array<T>& a, const Array<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

TEST(RenderSystem, EntriesAreThoseOfTheDefinition) {
  for (const double cutoff : {1.0, 4.0}) {
    const SurfelBasis basis = bumpy_surface(250);
    const Quadrature points = cover_surface(basis, 7);
    const RenderSystem system = assemble_render_system(basis, points, {.cutoff = cutoff});
    const Eigen::MatrixXd A = dense(system.near.A);
    const Eigen::MatrixXd expected = brute_force(basis, points, cutoff);
    EXPECT_LT((A - expected).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_EQ(system.near.A.entries(), static_cast<std::size_t>((expected.array() > 0).count()));

    const Eigen::MatrixXd normal = dense(system.normal_matrix);
    SurfelBasis wide = basis;
    // A Gaussian cut off at beta = c keeps 1 - c / (e^c - 1) of its variance.
    const double widening = 1 + 1 / (1 - cutoff / (std::exp(cutoff) - 1));
    for (SurfelBasis::Function& f : wide.function) {
      f.variance_u *= widening;
      f.variance_v *= widening;
    }
    const Eigen::MatrixXd B = brute_force(wide, at_functions(basis), cutoff);
    EXPECT_LT((dense(system.far.A) - B).cwiseAbs().maxCoeff(), 1e-12);
    EXPECT_NEAR(system.mu, 8 * 7, 1e-12);
    Eigen::MatrixXd lifted =
        product(expected.transpose(), expected) + system.mu * product(B.transpose(), B);
    EXPECT_NEAR(system.lambda, 0.03 * lifted.diagonal().mean(), 1e-12);
    lifted.diagonal().array() += system.lambda;
    EXPECT_LT((normal - lifted).cwiseAbs().maxCoeff(), 1e-12 * lifted.maxCoeff());
    EXPECT_GT(eigenvalues(normal)[0], 0.999 * system.lambda);
  }
}

TEST(RenderSystem, RowsSumToOneWhereAFunctionReaches) {
  const SurfelBasis basis = bumpy_surface(500);
  const RenderSystem system = assemble_render_system(basis, cover_surface(basis));
  std::size_t uncovered = 0;
  for (std::size_t q = 0; q < system.near.A.rows(); ++q) {
    double sum = 0;
    for (std::size_t e = system.near.A.row_begin[q]; e < system.near.A.row_begin[q + 1]; ++e) {
      sum += system.near.A.value[e];
    }
    if (sum == 0) {
      ++uncovered;
    } else {
      EXPECT_NEAR(sum, 1, 1e-14);
    }
  }
  EXPECT_EQ(uncovered, system.near.uncovered);
  EXPECT_LT(uncovered, system.near.A.rows());
}

TEST(RenderSystem, RightSideAndResidualAreThoseOfTheDefinition) {
  const SurfelBasis basis = bumpy_surface(200);
  const RenderSystem system = assemble_render_system(basis, cover_surface(basis, 5));
  const Array<Channels> w_0 = noise(basis.size(), 3);
  const Array<Channels> f = noise(system.near.A.rows(), 4);
  const Eigen::MatrixXd A = dense(system.near.A);
  const Eigen::MatrixXd B = dense(system.far.A);
  const Eigen::MatrixX4d b =
      product(A.transpose(), dense(f)) +
      product(
          system.mu * B.transpose() + system.lambda * Eigen::MatrixXd::Identity(B.rows(), B.cols()),
          dense(w_0));
  EXPECT_LT((dense(system.right_side(f, w_0)) - b).cwiseAbs().maxCoeff(), 1e-12);

  const Eigen::VectorXd covered = A.rowwise().sum().array().round();
  const Eigen::MatrixX4d residual = covered.asDiagonal() * (product(A, dense(w_0)) - dense(f));
  const Channels expected = residual.colwise().squaredNorm().transpose().array();
  EXPECT_LT((system.near.residual2(w_0, f) - expected).abs().maxCoeff(), 1e-11);
  EXPECT_LT((dense(system.near.residuals(w_0, f)) - residual).cwiseAbs().maxCoeff(), 1e-12);

  const Array<Channels> w = noise(basis.size(), 5);
  const Eigen::MatrixX4d far = product(B, dense(w)) - dense(w_0);
  const Eigen::MatrixX4d pull = dense(w) - dense(w_0);
  const Channels pull2 =
      system.mu * far.colwise().squaredNorm() + system.lambda * pull.colwise().squaredNorm();
  EXPECT_LT((system.pull2(w, w_0) - pull2).abs().maxCoeff(), 1e-9);
}

TEST(RenderSystem, WeightsAreThoseOfThePoints) {
  const SurfelBasis basis = bumpy_surface(150);
  const Quadrature points = cover_surface(basis, 4);
  const RenderSystem system = assemble_render_system(basis, points);
  Array<double> weight(points.size());
  for (std::size_t q = 0; q < weight.size(); ++q) weight[q] = 1.0 / static_cast<double>(q + 1);
  const Eigen::MatrixXd A = dense(system.near.A);
  const Eigen::MatrixXd B = dense(system.far.A);
  const Eigen::Map<const Eigen::VectorXd> D(weight.data(), A.rows());
  Eigen::MatrixXd expected =
      product(A.transpose() * D.asDiagonal(), A) + system.mu * product(B.transpose(), B);
  expected.diagonal().array() += system.lambda;
  EXPECT_LT((dense(system.weighted_normal_matrix(weight)) - expected).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(RenderSystem, ConstantTextureHasConstantCoefficients) {
  const SurfelBasis basis = bumpy_surface(200);
  const RenderSystem system = assemble_render_system(basis, cover_surface(basis), {.cutoff = 2});
  const auto b =
      system.right_side(constant(system.near.A.rows(), 0.3), constant(basis.size(), 0.3));
  for (const Channels& w : solve(system, b)) EXPECT_LT((w - 0.3).abs().maxCoeff(), 1e-10);
}

TEST(RenderSystem, SheetsBackToBackDoNotMix) {
  SurfelBasis basis = flat_grid(8, 0.7);
  const std::size_t front = basis.size();
  for (std::size_t k = 0; k < front; ++k) {
    const Vec3d behind = basis.function[k].position - Vec3d(0.2, 0.1, 0.01);
    basis.function.push_back(make_function(behind, {0, 0, -1}, 0.7, 0.7));
  }
  const Quadrature points = cover_surface(basis);
  const RenderSystem system = assemble_render_system(basis, points);
  const Eigen::MatrixXd normal = dense(system.normal_matrix);
  const auto n = static_cast<Eigen::Index>(front);
  EXPECT_EQ(normal.topRightCorner(n, n).norm(), 0);
  // Nor does one sheet bound the other's cells.
  const SurfelBasis alone = flat_grid(8, 0.7);
  const Quadrature expected = cover_surface(alone);
  for (std::size_t q = 0; q < expected.size(); ++q) {
    EXPECT_EQ(points.offset[q], expected.offset[q]);
  }
}

TEST(RenderSystem, SheetsThatFaceTheSameWayMixWithinTheReach) {
  const auto mixed = [](double distance) {
    const SurfelBasis basis = basis_of({make_function({0, 0, 0}, {0, 0, 1}, 1, 1),
                                        make_function({0, 0, distance}, {0, 0, 1}, 1, 1)});
    return dense(
               assemble_render_system(basis, cover_surface(basis), {.minified = 0}).normal_matrix)(
               0, 1) > 0;
  };
  EXPECT_TRUE(mixed(0.99 * std::sqrt(2.0)));
  EXPECT_FALSE(mixed(1.01 * std::sqrt(2.0)));
}

TEST(RenderSystem, FunctionsAcrossASharpEdgeDoNotMix) {
  const SurfelBasis basis = basis_of(
      {make_function({-0.1, 0, 0}, {0, 0, 1}, 1, 1), make_function({0, 0, -0.1}, {1, 0, 0}, 1, 1)});
  const RenderSystem system = assemble_render_system(basis, cover_surface(basis));
  EXPECT_EQ(dense(system.normal_matrix)(0, 1), 0);
}

TEST(RenderSystem, DuplicatesAreBoundedAndEqual) {
  SurfelBasis basis = flat_grid(6, 0.8);
  const std::size_t once = basis.size();
  for (std::size_t k = 0; k < once; ++k) basis.function.push_back(basis.function[k]);
  basis.function.push_back(basis.function[0]);
  basis.function.back().position.x() += 1e-30;
  basis.function.push_back(basis.function[1]);
  basis.function.back().position.x() += 1e-9;
  const RenderSystem system = assemble_render_system(basis, cover_surface(basis));
  expect_bounded(system, noise(system.near.A.rows(), 5), noise(basis.size(), 6));
  const auto b = system.right_side(noise(system.near.A.rows(), 5), constant(basis.size(), 0.5));
  const Array<Channels> w = solve(system, b);
  for (std::size_t k = 2; k < once; ++k) {
    EXPECT_LT((w[k] - w[once + k]).abs().maxCoeff(), 1e-9);
  }
}

TEST(RenderSystem, IsolatedFunctionsAreBounded) {
  for (const double scale : {1e-6, 1.0, 1e6}) {
    SurfelBasis basis;
    for (int k = 0; k < 5; ++k) {
      basis.function.push_back(make_function(Vec3d(100 * k, 0, 0) * scale, {0, 1, 1}, 2 * scale,
                                             scale, k, scale * scale));
    }
    const RenderSystem system = assemble_render_system(basis, cover_surface(basis));
    EXPECT_EQ(system.normal_matrix.entries(), basis.size());
    expect_bounded(system, noise(system.near.A.rows(), 7), noise(basis.size(), 8));
  }
}

TEST(RenderSystem, OneAndNoFunction) {
  const SurfelBasis one = basis_of({make_function({1, 2, 3}, {1, 2, 3}, 0.5, 0.5)});
  const RenderSystem system = assemble_render_system(one, cover_surface(one, 1));
  expect_bounded(system, constant(1, 1), constant(1, 0));

  const SurfelBasis none;
  const RenderSystem empty = assemble_render_system(none, cover_surface(none));
  EXPECT_EQ(empty.near.A.rows(), 0U);
  EXPECT_EQ(empty.normal_matrix.rows(), 0U);
  EXPECT_TRUE(empty.right_side({}, {}).empty());
}

TEST(RenderSystem, FunctionsThatReachNoPointKeepTheirReference) {
  const SurfelBasis basis = basis_of({make_function({0, 0, 0}, {0, 0, 1}, 1, 1),
                                      make_function({0.5, 0, 0}, {0, 0, 1}, 1e-4, 1e-4)});
  Quadrature points = at_functions(basis);
  points.begin = {0, 1, 1};
  points.offset.resize(1);
  const RenderSystem system =
      assemble_render_system(basis, points, {.minified = 0, .regularization = 1e-3});
  const Array<Channels> w = solve(system, system.right_side(constant(1, 1), constant(2, 0.25)));
  EXPECT_NEAR(w[1][0], 0.25, 1e-15);
  EXPECT_GT(w[0][0], 0.99);
}

TEST(RenderSystem, FitsTheTextureBetterThanItsReference) {
  const SurfelBasis basis = flat_grid(20, 0.7);
  const Quadrature points = cover_surface(basis);
  const RenderSystem system = assemble_render_system(basis, points);
  const auto texture = [](const Vec3d& p) { return 0.5 + 0.5 * std::sin(p.x()) * std::sin(p.y()); };
  Array<Channels> w_0(basis.size());
  Array<Channels> f(points.size());
  for (std::size_t k = 0; k < basis.size(); ++k) {
    const SurfelBasis::Function& function = basis.function[k];
    // A product of sine waves under a Gaussian loses exp(-variance) of its contrast.
    w_0[k].setConstant(0.5 + (texture(function.position) - 0.5) * std::exp(-function.variance_u));
    for (std::size_t q = points.begin[k]; q < points.begin[k + 1]; ++q) {
      const Vec2d offset = points.offset[q].cast<double>();
      f[q].setConstant(texture(function.position + offset.x() * function.tangent +
                               offset.y() * function.bitangent));
    }
  }
  const Array<Channels> w = solve(system, system.right_side(f, w_0));
  EXPECT_LT(system.near.residual2(w, f)[0], 0.3 * system.near.residual2(w_0, f)[0]);
}

TEST(RenderSystem, DoesNotDependOnTheThreads) {
  const SurfelBasis basis = flat_grid(80, 0.7);
  const auto run = [&](int threads) {
    set_thread_count(threads);
    const Quadrature points = cover_surface(basis);
    return std::pair(points, assemble_render_system(basis, points));
  };
  const auto [points, system] = run(1);
  const auto [f, w_0] = std::pair(noise(points.size(), 9), noise(basis.size(), 10));
  const Array<Channels> b = system.right_side(f, w_0);
  const Channels residual = system.near.residual2(w_0, f);
  for (const int threads : {2, 5}) {
    const auto [other_points, other] = run(threads);
    EXPECT_TRUE(same_bytes(points.offset, other_points.offset));
    EXPECT_TRUE(same_bytes(points.variance, other_points.variance));
    EXPECT_TRUE(same_bytes(system.near.A.row_begin, other.near.A.row_begin));
    EXPECT_TRUE(same_bytes(system.near.A.column, other.near.A.column));
    EXPECT_TRUE(same_bytes(system.near.A.value, other.near.A.value));
    EXPECT_TRUE(same_bytes(system.normal_matrix.column, other.normal_matrix.column));
    EXPECT_TRUE(same_bytes(system.normal_matrix.value, other.normal_matrix.value));
    EXPECT_TRUE(same_bytes(b, other.right_side(f, w_0)));
    EXPECT_TRUE((residual == other.near.residual2(w_0, f)).all());
  }
  set_thread_count(0);
}

TEST(RenderSystem, UnusableOptionsAreUsageErrors) {
  const SurfelBasis basis = flat_grid(2, 1);
  const Quadrature points = at_functions(basis);
  EXPECT_THROW(assemble_render_system(basis, points, {.cutoff = 0}), Error);
  EXPECT_THROW(assemble_render_system(basis, points, {.cutoff = std::nan("")}), Error);
  EXPECT_THROW(assemble_render_system(basis, points, {.regularization = 0}), Error);
  EXPECT_THROW(cover_surface(basis, 0), Error);
  EXPECT_TRUE(RenderSystemOptions{}.problems().empty());
}

TEST(CoverSurface, PointsLieNearestToTheirOwner) {
  const SurfelBasis basis = flat_grid(15, 0.7);
  const Quadrature points = cover_surface(basis, 12);
  ASSERT_EQ(points.size(), 12 * basis.size());
  for (std::size_t i = 0; i < basis.size(); ++i) {
    const SurfelBasis::Function& owner = basis.function[i];
    for (std::size_t q = points.begin[i]; q < points.begin[i + 1]; ++q) {
      const Vec2d offset = points.offset[q].cast<double>();
      const Vec3d p = owner.position + offset.x() * owner.tangent + offset.y() * owner.bitangent;
      for (const SurfelBasis::Function& other : basis.function) {
        EXPECT_LE((p - owner.position).norm(), (p - other.position).norm() + 1e-6);
      }
    }
  }
}

TEST(CoverSurface, PointsAreDenseWhereverTheSurfaceIs) {
  constexpr int kSide = 40;
  constexpr int kBlock = 5;
  constexpr int kPoints = 12;
  const SurfelBasis basis = flat_grid(kSide, 0.7);
  const Quadrature points = cover_surface(basis, kPoints);
  double area = 0;
  Eigen::MatrixXd count = Eigen::MatrixXd::Zero(kSide / kBlock, kSide / kBlock);
  for (std::size_t i = 0; i < basis.size(); ++i) {
    const SurfelBasis::Function& owner = basis.function[i];
    for (std::size_t q = points.begin[i]; q < points.begin[i + 1]; ++q) {
      const Vec2d offset = points.offset[q].cast<double>();
      const Vec3d p = owner.position + offset.x() * owner.tangent + offset.y() * owner.bitangent;
      // A cell is filtered with 1/16 of its area.
      const double share = 16.0 / kPoints * static_cast<double>(points.variance[i]);
      area += share;
      const auto x = static_cast<Eigen::Index>(std::floor((p.x() + 0.5) / kBlock));
      const auto y = static_cast<Eigen::Index>(std::floor((p.y() + 0.5) / kBlock));
      if (x >= 0 && y >= 0 && x < count.rows() && y < count.cols()) count(x, y) += share;
    }
  }
  // Border cells end at 0.95 instead of 0.5 spacings.
  const double side = kSide - 1 + 2 * 0.95;
  EXPECT_GT(area, kSide * kSide);
  EXPECT_LT(area, side * side);
  for (Eigen::Index y = 1; y + 1 < count.cols(); ++y) {
    for (Eigen::Index x = 1; x + 1 < count.rows(); ++x) {
      EXPECT_NEAR(count(x, y), kBlock * kBlock, 0.06 * kBlock * kBlock);
    }
  }
}

TEST(CoverSurface, PointsOfColorSamplesAreTheFunctionsThemselves) {
  const SurfelBasis basis = flat_grid(3, 0.7);
  const Quadrature points = at_functions(basis);
  ASSERT_EQ(points.size(), basis.size());
  EXPECT_EQ(points.functions(), basis.size());
  for (std::size_t i = 0; i < basis.size(); ++i) {
    EXPECT_EQ(points.begin[i], i);
    EXPECT_TRUE(points.offset[i].isZero(0));
  }
}

TEST(RenderSystem, FunctionsEndAtTheirHalfPlanes) {
  SurfelBasis basis = bumpy_surface(150);
  cut_functions(basis);
  const Quadrature points = cover_surface(basis, 7);
  for (const double cutoff : {1.0, 4.0}) {
    const EvaluatedBasis evaluated = evaluate_basis(basis, points, cutoff);
    EXPECT_LT((dense(evaluated.A) - brute_force(basis, points, cutoff)).cwiseAbs().maxCoeff(),
              1e-9);
    EXPECT_GT(evaluated.uncovered, 0U) << "points of functions whose centre is cut off";
  }
}

TEST(RenderSystem, CellsEndAtHalfPlanes) {
  SurfelBasis basis = flat_grid(5, 0.7, 0);
  basis.cut.assign(basis.size(), {SurfelBasis::Cut{{0, 0}, 0}, SurfelBasis::Cut{{0, 0}, 0}});
  const auto toward = [&](std::size_t k, const Vec3d& d) {
    const SurfelBasis::Function& f = basis.function[k];
    return Vec2d(d.dot(f.tangent), d.dot(f.bitangent));
  };
  basis.cut[4][0] = {toward(4, {1, 0, 0}), 0.2};
  const Quadrature points = cover_surface(basis, 16);
  double furthest = -1;
  for (std::size_t q = points.begin[4]; q < points.begin[5]; ++q) {
    furthest = std::max(furthest, points.offset[q].cast<double>().dot(basis.cut[4][0].direction));
  }
  EXPECT_LE(furthest, 0.2 + 1e-6);
  EXPECT_GT(furthest, 0.1);
}

}  // namespace
}  // namespace surfel
