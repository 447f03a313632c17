#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>

namespace surfel {
namespace {

constexpr int kDigitBits = 11;
constexpr std::size_t kBuckets = std::size_t{1} << kDigitBits;
using Histogram = std::array<std::uint32_t, kBuckets>;

struct Item {
  std::uint64_t key;
  std::uint32_t index;
};

std::size_t digit(std::uint64_t key, int shift) { return (key >> shift) & (kBuckets - 1); }

}  // namespace

Array<std::uint32_t> sorted_order(const Array<std::uint64_t>& keys) {
  const std::size_t n = keys.size();
  if (n > std::numeric_limits<std::uint32_t>::max()) {
    throw_input("", "more than 4294967295 elements cannot be ordered; split the cloud");
  }
  Array<std::uint32_t> order(n);
  const std::size_t grain = std::max<std::size_t>(1 << 14, n / 64 + 1);
  const std::size_t blocks = n == 0 ? 0 : (n - 1) / grain + 1;
  // Sorted keys are common (the order of a cloud that this library has put in order) and cheap to
  // tell.
  std::vector<std::uint8_t> sorted(blocks, 0);
  parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
    const auto first = keys.begin() + static_cast<std::ptrdiff_t>(begin == 0 ? 0 : begin - 1);
    sorted[begin / grain] = std::is_sorted(first, keys.begin() + static_cast<std::ptrdiff_t>(end));
    for (std::size_t i = begin; i < end; ++i) order[i] = static_cast<std::uint32_t>(i);
  });
  if (std::all_of(sorted.begin(), sorted.end(), [](std::uint8_t s) { return s != 0; })) {
    return order;
  }

  Array<Item> items(n);
  Array<Item> other(n);
  std::vector<std::uint64_t> varying(blocks, 0);
  parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
    std::uint64_t bits = 0;
    for (std::size_t i = begin; i < end; ++i) {
      items[i] = {keys[i], static_cast<std::uint32_t>(i)};
      bits |= keys[i] ^ keys[0];
    }
    varying[begin / grain] = bits;
  });
  std::uint64_t bits = 0;
  for (const std::uint64_t b : varying) bits |= b;

  std::vector<Histogram> histograms(blocks);
  for (int shift = 0; shift < 64; shift += kDigitBits) {
    if (digit(bits, shift) == 0) continue;
    parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
      Histogram& h = histograms[begin / grain];
      h.fill(0);
      for (std::size_t i = begin; i < end; ++i) ++h[digit(items[i].key, shift)];
    });
    std::uint32_t sum = 0;
    for (std::size_t d = 0; d < kBuckets; ++d) {
      for (Histogram& h : histograms) {
        const std::uint32_t count = h[d];
        h[d] = sum;
        sum += count;
      }
    }
    parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
      Histogram& h = histograms[begin / grain];
      for (std::size_t i = begin; i < end; ++i) other[h[digit(items[i].key, shift)]++] = items[i];
    });
    items.swap(other);
  }
  parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) order[i] = items[i].index;
  });
  return order;
}

}  // namespace surfel
