#include <algorithm>
#include <utility>

#include <surfel/base/group_by_key.h>
#include <surfel/solve/block_product.h>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfel/solve/block_product.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <surfel/base/fused-inl.h>

HWY_BEFORE_NAMESPACE();
namespace surfel {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kChannels = 4;  ///< Numbers of a Channels (sparse_matrix.h).
using Tag = hn::CappedTag<float, kChannels>;
constexpr std::size_t kLanes = std::min(kChannels, hn::MaxLanes(Tag()));
constexpr std::size_t kParts = kChannels / kLanes;

/// All channels of one unknown.
struct Sum {
  hn::Vec<Tag> part[kParts];

  HWY_INLINE void clear() {
    for (auto& p : part) p = hn::Zero(Tag());
  }
  HWY_INLINE void add(float factor, const float* HWY_RESTRICT x) {
    const Tag d;
    const auto broadcast = hn::Set(d, factor);
    for (std::size_t p = 0; p < kParts; ++p) {
      part[p] = mul_add(broadcast, hn::LoadU(d, x + p * kLanes), part[p]);
    }
  }
  HWY_INLINE void add(const Sum& other) {
    for (std::size_t p = 0; p < kParts; ++p) part[p] = hn::Add(part[p], other.part[p]);
  }
  HWY_INLINE void store(float* y) const {
    for (std::size_t p = 0; p < kParts; ++p) hn::StoreU(part[p], Tag(), y + p * kLanes);
  }
};

}  // namespace

/// y = a block's rows times x; y has room for all rows of a block.
void multiply_block(const BlockMatrixF& matrix, std::size_t block, const float* x, float* y) {
  Sum sum[kBlockRows];
  for (Sum& s : sum) s.clear();
  for (std::uint64_t e = matrix.block_begin[block]; e < matrix.block_begin[block + 1]; ++e) {
    const float* from = x + kChannels * matrix.column[e];
    const float* value = matrix.value.data() + kBlockRows * e;
    for (std::size_t row = 0; row < kBlockRows; ++row) sum[row].add(value[row], from);
  }
  for (std::size_t row = 0; row < kBlockRows; ++row) sum[row].store(y + kChannels * row);
}

void multiply_column_range(const BlockMatrixF& matrix, std::size_t begin, std::size_t end,
                           const float* x, float* y) {
  constexpr std::size_t kSums = 4;  // Side by side, as an addition takes several cycles.
  for (std::size_t column = begin; column < end; ++column) {
    Sum sum[kSums];
    for (Sum& s : sum) s.clear();
    for (std::uint64_t i = matrix.column_begin[column]; i < matrix.column_begin[column + 1]; ++i) {
      const BlockMatrixF::Place place = matrix.place[i];
      const float* value =
          matrix.value.data() + kBlockRows * (matrix.block_begin[place.block] + place.slot);
      const float* from = x + kChannels * kBlockRows * place.block;
      const std::size_t rows = matrix.rows_of(place.block);
      if (rows == kBlockRows) {
        for (std::size_t row = 0; row < kBlockRows; ++row) {
          sum[row % kSums].add(value[row], from + kChannels * row);
        }
      } else {
        for (std::size_t row = 0; row < rows; ++row) sum[0].add(value[row], from + kChannels * row);
      }
    }
    sum[0].add(sum[1]);
    sum[2].add(sum[3]);
    sum[0].add(sum[2]);
    sum[0].store(y + kChannels * (column - begin));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace surfel
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace surfel {

HWY_EXPORT(multiply_block);
HWY_EXPORT(multiply_column_range);

void BlockMatrixF::list_places() {
  Grouped<Place> places = group_by_key<Place>(rows, [&](const auto& add) {
    for (std::uint32_t block = 0; block < blocks(); ++block) {
      for (std::uint64_t e = block_begin[block]; e < block_begin[block + 1]; ++e) {
        add(column[e], Place{block, static_cast<std::uint32_t>(e - block_begin[block])});
      }
    }
  });
  column_begin = std::move(places.begin);
  place = std::move(places.item);
}

void multiply_rows(const BlockMatrixF& matrix, std::size_t begin, std::size_t end,
                   const ChannelsF* x, ChannelsF* y) {
  for (std::size_t block = begin / kBlockRows; block * kBlockRows < end; ++block) {
    ChannelsF* const to = y + (block * kBlockRows - begin);
    const std::size_t rows = matrix.rows_of(block);
    ChannelsF all[kBlockRows];
    HWY_DYNAMIC_DISPATCH(multiply_block)
    (matrix, block, x->data(), rows == kBlockRows ? to->data() : all[0].data());
    if (rows < kBlockRows) std::copy_n(all, rows, to);
  }
}

void multiply_columns(const BlockMatrixF& matrix, std::size_t begin, std::size_t end,
                      const ChannelsF* x, ChannelsF* y) {
  if (begin == end) return;
  HWY_DYNAMIC_DISPATCH(multiply_column_range)(matrix, begin, end, x->data(), y->data());
}

}  // namespace surfel
#endif
