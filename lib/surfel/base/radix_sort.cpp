#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/radix_sort.h>

namespace surfel {
namespace {

constexpr int kDigitBits = 11;  ///< A histogram of 2^11 counts stays in the first-level cache.
constexpr std::size_t kBuckets = std::size_t{1} << kDigitBits;
using Histogram = std::array<std::uint32_t, kBuckets>;
/// Up to here inserting one after the other is faster than to count digits.
constexpr std::size_t kFew = 24;
/// Buckets from here on are divided in parallel.
constexpr std::size_t kMany = std::size_t{1} << 18;

struct Item {
  std::uint64_t key;
  std::uint32_t index;
};

/// The digits by which keys are divided: the highest bits in which they differ.
struct Digits {
  int shift, bits;

  Digits(std::uint64_t differing, int most)
      : shift(std::max(0, static_cast<int>(std::bit_width(differing)) - most)),
        bits(static_cast<int>(std::bit_width(differing)) - shift) {}
  std::size_t count() const { return std::size_t{1} << bits; }
  std::size_t of(std::uint64_t key) const { return (key >> shift) & (count() - 1); }
};

/// Where sorted keys and their indices go.
struct Output {
  std::uint64_t* key;
  std::uint32_t* index;

  Output operator+(std::size_t n) const { return {key + n, index + n}; }
};

/// Puts `count` items in order. Arrays are of that length and are left as they happen to be.
void sort_few(Item* items, std::size_t count, Output out) {
  for (std::size_t i = 1; i < count; ++i) {
    const Item item = items[i];
    std::size_t to = i;
    for (; to > 0 && items[to - 1].key > item.key; --to) items[to] = items[to - 1];
    items[to] = item;
  }
  for (std::size_t i = 0; i < count; ++i) {
    out.key[i] = items[i].key;
    out.index[i] = items[i].index;
  }
}

void sort_alone(Item* items, Item* other, std::size_t count, Output out) {
  std::uint64_t differing = 0;
  if (count > kFew) {
    for (std::size_t i = 0; i < count; ++i) differing |= items[i].key ^ items[0].key;
  }
  if (differing == 0) {
    sort_few(items, count, out);
    return;
  }
  // A few items a bucket.
  const Digits digits(differing,
                      std::clamp(static_cast<int>(std::bit_width(count)) - 2, 3, kDigitBits));
  Histogram end;
  std::fill_n(end.begin(), digits.count(), 0U);
  for (std::size_t i = 0; i < count; ++i) ++end[digits.of(items[i].key)];
  std::exclusive_scan(end.begin(), end.begin() + static_cast<std::ptrdiff_t>(digits.count()),
                      end.begin(), 0U);
  for (std::size_t i = 0; i < count; ++i) other[end[digits.of(items[i].key)]++] = items[i];
  for (std::size_t d = 0, begin = 0; d < digits.count(); begin = end[d++]) {
    sort_alone(other + begin, items + begin, end[d] - begin, out + begin);
  }
}

/// Sorts as sort_alone() does, by all threads.
void sort_together(Item* items, Item* other, std::size_t n, Output out) {
  const std::size_t grain = std::max<std::size_t>(1 << 14, n / 64 + 1);
  const std::size_t blocks = (n + grain - 1) / grain;
  std::vector<std::uint64_t> varying(blocks, 0);
  parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
    for (std::size_t i = begin; i < end; ++i) varying[begin / grain] |= items[i].key ^ items[0].key;
  });
  std::uint64_t differing = 0;
  for (const std::uint64_t bits : varying) differing |= bits;
  const Digits digits(differing, kDigitBits);

  std::vector<Histogram> histograms(blocks);
  parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
    Histogram& h = histograms[begin / grain];
    h.fill(0);
    for (std::size_t i = begin; i < end; ++i) ++h[digits.of(items[i].key)];
  });
  std::vector<std::size_t> start(digits.count() + 1);
  std::uint32_t sum = 0;
  for (std::size_t d = 0; d < digits.count(); ++d) {
    start[d] = sum;
    for (Histogram& h : histograms) sum += std::exchange(h[d], sum);
  }
  start.back() = sum;
  parallel_for(n, grain, [&](std::size_t begin, std::size_t end, int) {
    Histogram& h = histograms[begin / grain];
    for (std::size_t i = begin; i < end; ++i) other[h[digits.of(items[i].key)]++] = items[i];
  });

  const auto bucket = [&](std::size_t d, auto&& sort) {
    sort(other + start[d], items + start[d], start[d + 1] - start[d], out + start[d]);
  };
  const auto divided = [&](std::size_t d) {
    return start[d + 1] - start[d] > kMany && digits.shift > 0;
  };
  for (std::size_t d = 0; d < digits.count(); ++d) {
    if (divided(d)) bucket(d, sort_together);
  }
  constexpr std::size_t kBucketGrain = 8;
  parallel_each(digits.count(), kBucketGrain, [&](std::size_t d) {
    if (!divided(d)) bucket(d, sort_alone);
  });
}

}  // namespace

Array<std::uint32_t> sort_keys(Array<std::uint64_t>& keys) {
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
  parallel_each(n, grain, [&](std::size_t i) {
    items[i] = {keys[i], static_cast<std::uint32_t>(i)};
  });
  // One range is not shared by threads, and the buckets of sort_together() may be more than its
  // keys.
  const auto sort = blocks == 1 ? sort_alone : sort_together;
  sort(items.data(), other.data(), n, {keys.data(), order.data()});
  return order;
}

}  // namespace surfel
