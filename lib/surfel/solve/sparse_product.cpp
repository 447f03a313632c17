#include <algorithm>

#include <surfel/solve/sparse_product.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/solve/sparse_product.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kChannels = 4;

/// Sum over a row's entries; four sums run side by side, as an addition takes several cycles.
HWY_INLINE void multiply_row(const float* value, const std::uint32_t* column, std::size_t count,
                             const float* HWY_RESTRICT x, float* HWY_RESTRICT y) {
  const hn::CappedTag<float, kChannels> d;
  constexpr std::size_t kLanes = std::min(kChannels, hn::MaxLanes(d));
  constexpr std::size_t kParts = kChannels / kLanes;
  constexpr std::size_t kSums = 4;
  hn::Vec<decltype(d)> sum[kSums][kParts];
  for (auto& parts : sum) {
    for (auto& part : parts) part = hn::Zero(d);
  }
  const auto add = [&](std::size_t slot, std::size_t entry) HWY_ATTR {
    const float* from = x + kChannels * column[entry];
    const auto factor = hn::Set(d, value[entry]);
    for (std::size_t part = 0; part < kParts; ++part) {
      sum[slot][part] = hn::MulAdd(factor, hn::LoadU(d, from + part * kLanes), sum[slot][part]);
    }
  };
  std::size_t entry = 0;
  for (; entry + kSums <= count; entry += kSums) {
    for (std::size_t slot = 0; slot < kSums; ++slot) add(slot, entry + slot);
  }
  for (; entry < count; ++entry) add(0, entry);
  for (std::size_t part = 0; part < kParts; ++part) {
    hn::StoreU(hn::Add(hn::Add(sum[0][part], sum[1][part]), hn::Add(sum[2][part], sum[3][part])), d,
               y + part * kLanes);
  }
}

}  // namespace

void multiply_float(const SparseMatrixF& matrix, std::size_t begin, std::size_t end, const float* x,
                    float* y) {
  for (std::size_t row = begin; row < end; ++row) {
    const std::uint64_t first = matrix.row_begin[row];
    multiply_row(matrix.value.data() + first, matrix.column.data() + first,
                 matrix.row_begin[row + 1] - first, x, y + kChannels * (row - begin));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(multiply_float);

void multiply_rows(const SparseMatrixF& matrix, std::size_t begin, std::size_t end,
                   const ChannelsF* x, ChannelsF* y) {
  if (begin == end) return;
  HWY_DYNAMIC_DISPATCH(multiply_float)(matrix, begin, end, x->data(), y->data());
}

}  // namespace surfel
#endif
