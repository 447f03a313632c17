#include <surfel/solve/batch_cholesky.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/solve/batch_cholesky.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<double, kCholeskyBatch>;
using V = hn::Vec<D>;

/// Makes the entries (i .. i + kRows - 1, j) of L. Several rows go side by side, as a row's sum has
/// to wait for its last addition.
template <std::size_t kRows>
HWY_INLINE void eliminate(double* a, std::size_t i, std::size_t j, V inverse_root) {
  const D d;
  V sum[kRows];
  for (std::size_t r = 0; r < kRows; ++r) sum[r] = hn::Load(d, a + batch_entry(i + r, j));
  for (std::size_t k = 0; k < j; ++k) {
    const V pivot_row = hn::Load(d, a + batch_entry(j, k));
    for (std::size_t r = 0; r < kRows; ++r) {
      sum[r] = neg_mul_add(hn::Load(d, a + batch_entry(i + r, k)), pivot_row, sum[r]);
    }
  }
  for (std::size_t r = 0; r < kRows; ++r) {
    hn::Store(hn::Mul(sum[r], inverse_root), d, a + batch_entry(i + r, j));
  }
}

/// Factorises in place: A = L L^T; the diagonal holds the inverses of L's diagonal.
HWY_INLINE void factorize(std::size_t n, double* a) {
  const D d;
  const V one = hn::Set(d, 1.0);
  for (std::size_t j = 0; j < n; ++j) {
    V pivot = hn::Load(d, a + batch_entry(j, j));
    for (std::size_t k = 0; k < j; ++k) {
      const V entry = hn::Load(d, a + batch_entry(j, k));
      pivot = neg_mul_add(entry, entry, pivot);
    }
    const V inverse_root = hn::Div(one, hn::Sqrt(pivot));
    hn::Store(inverse_root, d, a + batch_entry(j, j));
    std::size_t i = j + 1;
    for (; i + 4 <= n; i += 4) eliminate<4>(a, i, j, inverse_root);
    for (; i < n; ++i) eliminate<1>(a, i, j, inverse_root);
  }
}

/// Row `last` of L^-1: solves L^T g = e_last.
HWY_INLINE void substitute_back(std::size_t last, const double* a, double* g) {
  const D d;
  hn::Store(hn::Load(d, a + batch_entry(last, last)), d, g + last * kCholeskyBatch);
  for (std::size_t j = 0; j < last; ++j) hn::Store(hn::Zero(d), d, g + j * kCholeskyBatch);
  for (std::size_t i = last; i > 0; --i) {
    const V known = hn::Load(d, g + i * kCholeskyBatch);
    for (std::size_t j = 0; j < i; ++j) {
      double* to = g + j * kCholeskyBatch;
      hn::Store(neg_mul_add(hn::Load(d, a + batch_entry(i, j)), known, hn::Load(d, to)), d, to);
    }
    double* next = g + (i - 1) * kCholeskyBatch;
    hn::Store(hn::Mul(hn::Load(d, next), hn::Load(d, a + batch_entry(i - 1, i - 1))), d, next);
  }
}

}  // namespace

void last_inverse_rows_simd(std::size_t n, std::size_t count, double* matrices, double* rows) {
  for (std::size_t lane = 0; lane < kCholeskyBatch; lane += hn::Lanes(D())) {
    factorize(n, matrices + lane);
    for (std::size_t r = 0; r < count; ++r) {
      substitute_back(n - count + r, matrices + lane, rows + r * n * kCholeskyBatch + lane);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(last_inverse_rows_simd);

void last_inverse_rows(std::size_t n, std::size_t count, double* matrices, double* rows) {
  HWY_DYNAMIC_DISPATCH(last_inverse_rows_simd)(n, count, matrices, rows);
}

}  // namespace surfel
#endif
