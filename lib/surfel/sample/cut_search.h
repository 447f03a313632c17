#pragma once

#include <cmath>
#include <cstddef>
#include <utility>

#include <surfel/base/elementary.h>
#include <surfel/base/parallel.h>
#include <surfel/sample/detail_tree.h>

namespace surfel {

/// Two choices of cells, next to each other in price.
struct CutBracket {
  DetailTree::Cut coarse;  ///< Not fine enough, or the cut at the highest price.
  DetailTree::Cut fine;    ///< Fine enough, or the cut at the lowest price.
};

/// Finds the highest price at which fine_enough(cut) holds; it must hold for all finer cuts, too.
/// \param precision  precision of the price's logarithm.
template <class Test>
CutBracket bracket_cuts(const DetailTree& tree, double precision, const Test& fine_enough) {
  double low = portable::log(tree.lowest_price());
  double high = portable::log(tree.highest_price());
  CutBracket out{tree.cut(portable::exp(high)), {}};
  if (fine_enough(out.coarse)) return {out.coarse, out.coarse};
  out.fine = tree.cut(portable::exp(low));
  while (high - low > precision) {
    const double middle = (low + high) / 2;
    DetailTree::Cut cut = tree.cut(portable::exp(middle));
    if (fine_enough(cut)) {
      low = middle;
      out.fine = std::move(cut);
    } else {
      high = middle;
      out.coarse = std::move(cut);
    }
  }
  return out;
}

/// Mean of value(i) over at most 50,000 numbers i, evenly spread below `count`: enough to tell the
/// number of samples that a field makes to better than 1 %.
template <class Value>
double mean_of_probes(std::size_t count, const Value& value) {
  constexpr std::size_t kProbes = 50000;
  const std::size_t stride = count / kProbes + 1;
  Array<double> values((count + stride - 1) / stride);
  parallel_each(values.size(), 1 << 10, [&](std::size_t i) { values[i] = value(i * stride); });
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

}  // namespace surfel
