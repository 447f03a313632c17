// Zwicker, Pfister, van Baar, Gross 2001, "Surface Splatting", section 5 and appendix A.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>

#include <surfel/base/box_tree.h>
#include <surfel/base/elementary.h>
#include <surfel/base/parallel.h>
#include <surfel/texture/gram_system.h>

namespace surfel {
namespace {

constexpr std::size_t kLanes = 8;        ///< Functions in a block.
constexpr std::size_t kBlockGrain = 64;  ///< Blocks.
constexpr std::size_t kGramRowGrain = 1 << 14;
/// Surfels whose normals are further apart than this cosine (60 degrees) are not coupled: between
/// them there is a sharp edge, or they are the two sides of a sheet.
constexpr double kCoupledCosine = 0.5;
constexpr double kMinSum2 = 2 * (1 + kCoupledCosine);  ///< Least |n_k + n_j|^2 of a coupled pair.
/// Surfels further apart along their mean normal than this many standard deviations of the kernels'
/// minor axes (root mean square of the two), squared, lie on different sheets: at 1, noise does not
/// part a sheet, whose kernels are wider than the noise is high.
constexpr double kThickness2 = 1;
/// Error of the coefficients, relative to the largest, that the entries left out may cause: below
/// the rounding of the single precision in which coefficients are stored would be wasted.
constexpr double kAccuracy = 1e-6;
constexpr double kMinReach = 3;     ///< Within it the overlap is counted.
constexpr double kMaxReach = 8.5;   ///< exp(-8.5^2 / 2) is the rounding error of the diagonal.
constexpr double kNowhere = 1e100;  ///< Far from everything; its square is finite.

/// kLanes functions that follow each other in the basis, a column each, as the pair metric wants
/// them. Lanes without a function lie nowhere.
struct Block {
  double x[kLanes], y[kLanes], z[kLanes];
  double nx[kLanes], ny[kLanes], nz[kLanes];
  /// Covariance in space, V_k thickened by its minor variance along the normal.
  double xx[kLanes], xy[kLanes], xz[kLanes], yy[kLanes], yz[kLanes], zz[kLanes];
  double minor[kLanes];   ///< Smaller principal variance.
  double reach2[kLanes];  ///< Largest exponent d^T (V_k + V_j)^-1 d that the function asks for.
  double area[kLanes];
};

/// Box around functions.
struct Box {
  Eigen::Array3d min = Eigen::Array3d::Constant(kNowhere);
  Eigen::Array3d max = Eigen::Array3d::Constant(-kNowhere);
  double major = 0;   ///< Largest principal variance.
  double reach2 = 0;  ///< Largest.

  void add(const Box& other) {
    min = min.min(other.min);
    max = max.max(other.max);
    major = std::max(major, other.major);
    reach2 = std::max(reach2, other.reach2);
  }
  double distance2(const Box& other) const {
    return (min - other.max).max(other.min - max).max(0.0).matrix().squaredNorm();
  }
};

/// The functions that a row couples with, and the values that their entries are computed from.
/// There is room for a block more, as values are computed by blocks.
struct Couplings {
  Array<std::uint32_t> column;
  Array<double> exponent;  ///< d^T (V_k + V_j)^-1 d
  Array<double> det;       ///< |V_k + V_j|
  Array<double> area;      ///< a_j
  std::size_t count = 0;

  void reserve(std::size_t more) {
    const std::size_t need = count + more + kLanes;
    if (column.size() >= need) return;
    column.resize(2 * need);
    exponent.resize(2 * need);
    det.resize(2 * need);
    area.resize(2 * need);
  }
};

/// Finds the coupled pairs, row by row, of kernels of any size, in ascending order: the basis lies
/// along a space-filling curve, so that the boxes around runs of it are small.
class PairSearch {
 public:
  explicit PairSearch(const SurfelBasis& basis)
      : basis_(basis), blocks_((basis.size() + kLanes - 1) / kLanes) {
    isotropic_ = std::all_of(basis.function.begin(), basis.function.end(),
                             [](const auto& f) { return f.variance_u == f.variance_v; });
    parallel_for(blocks_.size(), kBlockGrain, [&](std::size_t begin, std::size_t end, int) {
      for (std::size_t b = begin; b < end; ++b) fill_block(b);
    });
  }

  /// \param reach2  of every function, the largest exponent it asks for.
  void set_reach(const Array<double>& reach2) {
    for (std::size_t k = 0; k < basis_.size(); ++k) {
      blocks_[k / kLanes].reach2[k % kLanes] = reach2[k];
    }
    tree_ = {basis_.size(), [&](std::size_t k) {
               const SurfelBasis::Function& f = basis_.function[k];
               return Box{f.position.array(), f.position.array(),
                          std::max(f.variance_u, f.variance_v), reach2[k]};
             }};
  }

  /// Calls body(k, couplings) for every row k, rows in parallel. \tparam kLower  only of functions
  /// up to k.
  template <bool kLower, class Body>
  void for_each_row(const Body& body) const {
    parallel_for(blocks_.size(), kBlockGrain, [&](std::size_t begin, std::size_t end, int) {
      Couplings couplings;
      std::vector<std::uint32_t> near;
      for (std::size_t b = begin; b < end; ++b) {
        near.clear();
        tree_.for_each_leaf([&](const Box& box) { return may_couple(tree_.leaf(b), box); },
                            [&](std::size_t leaf) {
                              if (kLower && leaf > b) return;
                              near.push_back(static_cast<std::uint32_t>(leaf));
                            });
        for (std::size_t lane = 0; lane < tree_.leaf_size(b); ++lane) {
          const Box row = box_of(b, lane);
          couplings.count = 0;
          for (const std::uint32_t other : near) {
            if (!may_couple(row, tree_.leaf(other))) continue;
            if (isotropic_) {
              couple<true>(b, lane, other, couplings);
            } else {
              couple<false>(b, lane, other, couplings);
            }
          }
          const std::size_t k = b * kLanes + lane;
          if constexpr (kLower) {
            while (couplings.column[couplings.count - 1] > k) --couplings.count;
          }
          body(k, couplings);
        }
      }
    });
  }

 private:
  void fill_block(std::size_t b) {
    Block& block = blocks_[b];
    std::fill_n(reinterpret_cast<double*>(&block), sizeof(Block) / sizeof(double), 0.0);
    std::fill_n(block.x, kLanes, kNowhere);
    const std::size_t lanes = std::min(kLanes, basis_.size() - b * kLanes);
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      const SurfelBasis::Function& f = basis_.function[b * kLanes + lane];
      const double minor = std::min(f.variance_u, f.variance_v);
      const Eigen::Matrix3d covariance =
          minor * Eigen::Matrix3d::Identity() +
          (f.variance_u - minor) * f.tangent * f.tangent.transpose() +
          (f.variance_v - minor) * f.bitangent * f.bitangent.transpose();
      block.x[lane] = f.position.x();
      block.y[lane] = f.position.y();
      block.z[lane] = f.position.z();
      block.nx[lane] = f.normal.x();
      block.ny[lane] = f.normal.y();
      block.nz[lane] = f.normal.z();
      block.xx[lane] = covariance(0, 0);
      block.xy[lane] = covariance(0, 1);
      block.xz[lane] = covariance(0, 2);
      block.yy[lane] = covariance(1, 1);
      block.yz[lane] = covariance(1, 2);
      block.zz[lane] = covariance(2, 2);
      block.minor[lane] = minor;
      block.area[lane] = f.area;
    }
  }

  /// A function as a box; as wide as any of its block.
  Box box_of(std::size_t b, std::size_t lane) const {
    const Block& block = blocks_[b];
    Box box;
    box.min = box.max = {block.x[lane], block.y[lane], block.z[lane]};
    box.major = tree_.leaf(b).major;
    box.reach2 = block.reach2[lane];
    return box;
  }

  /// d^2 is at most reach^2 times the largest variance in the mean plane, plus the thickness^2.
  bool may_couple(const Box& p, const Box& q) const {
    return p.distance2(q) <=
           (std::max(p.reach2, q.reach2) + kThickness2 / 2) * (p.major + q.major) * (1 + 1e-12);
  }

  /// Adds the functions of block `other` that function `lane` of block b couples with. Results
  /// depend on sums of the two functions' values, and on squares and products of two of their
  /// differences: if the two are exchanged, the bits are the same.
  template <bool kIsotropic>
  void couple(std::size_t b, std::size_t lane, std::size_t other, Couplings& out) const {
    const Block& p = blocks_[b];
    const Block& q = blocks_[other];
    double exponent[kLanes];
    double det[kLanes];
    double excess[kLanes];  // Excess by the strictest of the three rules.
    for (std::size_t i = 0; i < kLanes; ++i) {
      const double dx = q.x[i] - p.x[lane];
      const double dy = q.y[i] - p.y[lane];
      const double dz = q.z[i] - p.z[lane];
      const double sx = q.nx[i] + p.nx[lane];
      const double sy = q.ny[i] + p.ny[lane];
      const double sz = q.nz[i] + p.nz[lane];
      const double sum2 = sx * sx + sy * sy + sz * sz;
      const double along = sx * dx + sy * dy + sz * dz;
      const double tx = sy * dz - sz * dy;
      const double ty = sz * dx - sx * dz;
      const double tz = sx * dy - sy * dx;
      if constexpr (kIsotropic) {
        const double variance = q.minor[i] + p.minor[lane];
        exponent[i] = (tx * tx + ty * ty + tz * tz) / (variance * sum2);
        det[i] = variance * variance;
      } else {
        const double xx = q.xx[i] + p.xx[lane];
        const double xy = q.xy[i] + p.xy[lane];
        const double xz = q.xz[i] + p.xz[lane];
        const double yy = q.yy[i] + p.yy[lane];
        const double yz = q.yz[i] + p.yz[lane];
        const double zz = q.zz[i] + p.zz[lane];
        // M, the sum of the covariances in the plane normal to s, has the determinant
        // s^T adj(C) s / s^2, and d^T M^-1 d is the form of C at d turned by a right angle about s,
        // over that determinant and s^2.
        const double cofactors =
            sx * sx * (yy * zz - yz * yz) + sy * sy * (xx * zz - xz * xz) +
            sz * sz * (xx * yy - xy * xy) +
            2 * (sx * sy * (xz * yz - xy * zz) + sx * sz * (xy * yz - xz * yy) +
                 sy * sz * (xy * xz - xx * yz));
        const double form = tx * tx * xx + ty * ty * yy + tz * tz * zz +
                            2 * (tx * ty * xy + tx * tz * xz + ty * tz * yz);
        exponent[i] = form / cofactors;
        det[i] = cofactors / sum2;
      }
      const double reach2 = q.reach2[i] > p.reach2[lane] ? q.reach2[i] : p.reach2[lane];
      const double too_far = exponent[i] - reach2;
      const double too_high = 2 * along * along - kThickness2 * (q.minor[i] + p.minor[lane]) * sum2;
      const double too_steep = kMinSum2 - sum2;
      const double worse = too_far > too_high ? too_far : too_high;
      excess[i] = worse > too_steep ? worse : too_steep;
    }
    out.reserve(kLanes);
    std::size_t n = out.count;
    for (std::size_t i = 0; i < kLanes; ++i) {
      out.column[n] = static_cast<std::uint32_t>(other * kLanes + i);
      out.exponent[n] = exponent[i];
      out.det[n] = det[i];
      out.area[n] = q.area[i];
      n += excess[i] <= 0 ? 1 : 0;
    }
    out.count = n;
  }

  const SurfelBasis& basis_;
  bool isotropic_;  ///< All functions.
  Array<Block> blocks_;
  BoxTree<Box, kLanes, 4> tree_;  ///< Its leaves are the blocks.
};

/// kappa^2 = (sigma / h)^2 of a function that couples with `count` others and itself within
/// kMinReach: in the metric of both, pi reach^2 2 sigma^2 holds so many of density 1 / h^2. At the
/// border of a surface there are fewer, but a pair takes the larger reach of the two.
double overlap(std::size_t count) {
  return static_cast<double>(count) / (2 * std::numbers::pi * kMinReach * kMinReach);
}

/// Squared reach that keeps the coefficients to kAccuracy. On jittered grids, kappa 0.5 to 1.5,
/// cond(R) is measured to be about exp(0.9 + 15 kappa^2), and the error of the coefficients, over
/// their largest, cond(R) exp(-reach^2 / 2) / 5. Beyond cond(R) = 1e6 there is no such accuracy.
double overlap_reach2(double overlap) {
  const double log_condition = std::min(0.9 + 15 * overlap, portable::log(1e6));
  return std::clamp(2 * (log_condition - portable::log(5 * kAccuracy)), kMinReach * kMinReach,
                    kMaxReach * kMaxReach);
}

/// How far functions couple.
struct Reach {
  Array<double> squared;   ///< Squared reach of every function.
  Array<double> left_out;  ///< GramSystem::left_out of every function.
};

Reach choose_reach(PairSearch& search, std::size_t count) {
  Reach reach;
  reach.squared.assign(count, kMinReach * kMinReach);
  reach.left_out.resize(count);
  search.set_reach(reach.squared);
  search.for_each_row<false>([&](std::size_t k, const Couplings& near) {
    const double kappa2 = overlap(near.count);
    const double reach2 = overlap_reach2(kappa2);
    reach.squared[k] = reach2;
    // Of a constant, the integral of the Gaussian beyond the reach.
    reach.left_out[k] = 4 * std::numbers::pi * kappa2 * portable::exp(-reach2 / 2);
  });
  return reach;
}

/// Entries of a row, a_k a_j G_{V_k + V_j}(u_k - u_j) [SS01 (11)]. Entries are computed by whole
/// blocks: Eigen's exponential is not the same function, to the last bit, for a vector register and
/// for the values left over.
void write_entries(double area, const Couplings& couplings, double* value) {
  using Lanes = Eigen::Array<double, kLanes, 1>;
  for (std::size_t i = 0; i < couplings.count; i += kLanes) {
    const Eigen::Map<const Lanes> exponent(couplings.exponent.data() + i);
    const Eigen::Map<const Lanes> det(couplings.det.data() + i);
    const Eigen::Map<const Lanes> other_area(couplings.area.data() + i);
    const Lanes entry =
        (-exponent / 2).exp() * (area * other_area) / (2 * std::numbers::pi * det.sqrt());
    std::copy_n(entry.data(), std::min(kLanes, couplings.count - i), value + i);
  }
}

}  // namespace

// R of SS01 (11), whose entries are the inner products of SS01 appendix A.
GramSystem make_gram_system(const SurfelBasis& basis) {
  PairSearch search(basis);
  GramSystem system;
  const Reach reach = choose_reach(search, basis.size());
  search.set_reach(reach.squared);
  if (basis.size() > 0) {
    const auto [least, most] = std::minmax_element(reach.squared.begin(), reach.squared.end());
    system.min_reach = std::sqrt(*least);
    system.max_reach = std::sqrt(*most);
    system.left_out = *std::max_element(reach.left_out.begin(), reach.left_out.end());
  }

  SymmetricMatrix& matrix = system.matrix;
  matrix.row_begin.resize(basis.size() + 1);
  matrix.row_begin[0] = 0;
  search.for_each_row<true>([&](std::size_t k, const Couplings& couplings) {
    matrix.row_begin[k + 1] = couplings.count;
  });
  std::partial_sum(matrix.row_begin.begin(), matrix.row_begin.end(), matrix.row_begin.begin());
  matrix.column.resize(matrix.row_begin.back());
  matrix.value.resize(matrix.row_begin.back());
  search.for_each_row<true>([&](std::size_t k, const Couplings& couplings) {
    const std::uint64_t begin = matrix.row_begin[k];
    std::copy_n(couplings.column.begin(), couplings.count,
                matrix.column.begin() + static_cast<std::ptrdiff_t>(begin));
    write_entries(basis.function[k].area, couplings, matrix.value.data() + begin);
  });
  return system;
}

void add_to_diagonal(SymmetricMatrix& matrix, double lambda) {
  const double added = lambda * matrix.trace() / static_cast<double>(matrix.rows());
  for (std::size_t row = 0; row < matrix.rows(); ++row) matrix.diagonal(row) += added;
}

Array<double> scale_to_unit_diagonal(SymmetricMatrix& matrix) {
  Array<double> scale(matrix.rows());
  for (std::size_t row = 0; row < matrix.rows(); ++row) {
    scale[row] = 1 / std::sqrt(matrix.diagonal(row));
  }
  parallel_for(matrix.rows(), kGramRowGrain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t row = begin; row < end; ++row) {
      for (std::uint64_t i = matrix.row_begin[row]; i < matrix.row_begin[row + 1]; ++i) {
        matrix.value[i] *= scale[row] * scale[matrix.column[i]];
      }
    }
  });
  return scale;
}

}  // namespace surfel
