#pragma once

#include <vector>

#include <surfel/base/export.h>
#include <surfel/base/group_by_key.h>
#include <surfel/solve/symmetric_matrix.h>

namespace surfel {

/// Products of a symmetric matrix with vectors, in parallel, from one triangle of it. Rows are
/// worked on in ranges: what a range adds to rows before it, its halo, is kept apart, and added in
/// the order of the ranges, so that the result does not depend on the number of threads. The halo
/// is small where neighbours in the matrix are neighbours in the order, as they are along a
/// space-filling curve.
class SURFEL_API SymmetricProduct {
 public:
  /// Rows of a range: some 45 x 45 neighbours on a surface, whose unknowns fit into the
  /// second-level cache, and whose halo is about as many.
  static constexpr std::size_t kRange = 2048;

  /// \param matrix  must outlive the product; its values may change.
  explicit SymmetricProduct(const SymmetricMatrix& matrix);

  /// y = A x. One product at a time.
  void multiply(const Array<Channels>& x, Array<Channels>& y);

 private:
  /// The sums that the rows of a range add to rows before it.
  struct Halo {
    Array<std::uint32_t> row;   ///< The rows before the range that it adds to.
    Array<std::uint32_t> slot;  ///< For each entry before the range, its row's place in `row`.
    std::uint64_t first_sum;    ///< Place in halo_sum_ of the first row's sum.
  };
  Halo find_halo(std::size_t range) const;

  const SymmetricMatrix& matrix_;
  std::vector<Halo> halo_;  ///< By range.
  Array<Channels> halo_sum_;
  Grouped<std::uint64_t> incoming_;  ///< By row: the places in halo_sum_ that are added to it.
};

/// |b - A x| / |b| of the worst channel.
SURFEL_API double relative_residual(const SymmetricMatrix& matrix, const Array<Channels>& b,
                                    const Array<Channels>& x);

}  // namespace surfel
