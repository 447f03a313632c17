#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <surfel/base/random.h>
#include <surfel/solve/inverse_factor.h>

#include "support/dense_algebra.h"

namespace surfel::test {

/// A x = b.
struct System {
  SymmetricMatrix matrix;
  Array<Channels> b;
};

/// Places of the cells of a square of side x side, in Morton's order.
inline std::vector<Eigen::Vector2i> morton_cells(int side) {
  const auto spread = [](std::uint32_t v) {
    std::uint64_t bits = 0;
    for (int i = 0; i < 16; ++i) bits |= static_cast<std::uint64_t>(v >> i & 1U) << 2 * i;
    return bits;
  };
  std::vector<Eigen::Vector2i> cells;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) cells.emplace_back(x, y);
  }
  const auto code = [&](const Eigen::Vector2i& c) { return spread(c.x()) | spread(c.y()) << 1; };
  std::sort(cells.begin(), cells.end(),
            [&](const auto& a, const auto& b) { return code(a) < code(b); });
  return cells;
}

/// Gram matrix of Gaussians of that standard deviation, in units of the spacing, on a jittered grid
/// of side x side, cut at 6 of its own deviations; and sums of a random image under them, in three
/// channels. With unit diagonal, but for `ridge`.
inline System gaussian_gram(int side, double sigma, double ridge = 0, double jitter = 0.3) {
  const std::vector<Eigen::Vector2i> cells = morton_cells(side);
  const auto n = cells.size();
  std::vector<std::uint32_t> index(n);
  std::vector<Vec2d> point(n);
  const auto cell_at = [&](int x, int y) { return static_cast<std::size_t>(y) * side + x; };
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t cell = cell_at(cells[i].x(), cells[i].y());
    index[cell] = static_cast<std::uint32_t>(i);
    point[i] = cells[i].cast<double>() + jitter * Vec2d(2 * random_uniform(1, cell, 0) - 1,
                                                        2 * random_uniform(1, cell, 1) - 1);
  }
  const double cut = 6 * std::sqrt(2.0) * sigma;
  const int reach = static_cast<int>(std::ceil(cut + 1));
  System system;
  system.matrix.row_begin.push_back(0);
  std::vector<std::pair<std::uint32_t, double>> row;
  for (std::size_t i = 0; i < n; ++i) {
    row.clear();
    Channels sum = Channels::Zero();
    const Eigen::Vector2i lo = (cells[i].array() - reach).max(0);
    const Eigen::Vector2i hi = (cells[i].array() + reach).min(side - 1);
    for (int y = lo.y(); y <= hi.y(); ++y) {
      for (int x = lo.x(); x <= hi.x(); ++x) {
        const std::size_t cell = cell_at(x, y);
        const std::uint32_t j = index[cell];
        const double squared = (point[i] - point[j]).squaredNorm();
        if (j <= i && squared <= cut * cut) {
          row.emplace_back(j, std::exp(-squared / (4 * sigma * sigma)) + (j == i ? ridge : 0));
        }
        const double kernel =
            2 * std::exp(-(Vec2d(x, y) - point[i]).squaredNorm() / (2 * sigma * sigma));
        for (int c = 0; c < 3; ++c) sum[c] += kernel * random_uniform(2, cell, c);
      }
    }
    std::sort(row.begin(), row.end());
    for (const auto& [column, value] : row) {
      system.matrix.column.push_back(column);
      system.matrix.value.push_back(value);
    }
    system.matrix.row_begin.push_back(system.matrix.column.size());
    system.b.push_back(sum);
  }
  return system;
}

inline Eigen::MatrixXd dense(const SymmetricMatrix& matrix) {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(matrix.rows(), matrix.rows());
  for (std::size_t i = 0; i < matrix.rows(); ++i) {
    for (std::uint64_t e = matrix.row_begin[i]; e < matrix.row_begin[i + 1]; ++e) {
      result(i, matrix.column[e]) = result(matrix.column[e], i) = matrix.value[e];
    }
  }
  return result;
}

/// \param matrix  symmetric.
inline SymmetricMatrix sparse(const Eigen::MatrixXd& matrix) {
  SymmetricMatrix result;
  result.row_begin.push_back(0);
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      if (matrix(i, j) == 0 && i != j) continue;
      result.column.push_back(static_cast<std::uint32_t>(j));
      result.value.push_back(matrix(i, j));
    }
    result.row_begin.push_back(result.column.size());
  }
  return result;
}

inline Eigen::MatrixXd dense(const Array<Channels>& x) {
  Eigen::MatrixXd result(x.size(), 4);
  for (std::size_t i = 0; i < x.size(); ++i) result.row(i) = x[i].transpose();
  return result;
}

/// G, written out.
inline Eigen::MatrixXd dense(const InverseFactor& factor) {
  const std::size_t n = factor.rows();
  Eigen::MatrixXd result(n, n);
  Array<ChannelsF> x(n), y(n);
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = 0; i < n; ++i) x[i].setConstant(i == j ? 1.0F : 0.0F);
    factor.multiply(0, n, x.data(), y.data());
    for (std::size_t i = 0; i < n; ++i) result(i, j) = static_cast<double>(y[i][0]);
  }
  return result;
}

}  // namespace surfel::test
