#pragma once

#include <cstddef>
#include <cstdint>
#include <numeric>

#include <surfel/base/types.h>

namespace surfel {

/// Items sorted by key; items of one key stay in the order in which they came.
template <class Item>
struct Grouped {
  Array<std::uint64_t> begin;  ///< First item of every key, then the number of items.
  Array<Item> item;
};

/// Sorts items by their key, a number below `keys`, by counting (Knuth, "The Art of Computer
/// Programming" 3, 5.2).
/// \param keys      Number of keys. Every key is less.
/// \param for_each  for_each(add) calls add(key, item) for every item. It is called twice, and must
///                  do the same each time.
template <class Item, class ForEach>
Grouped<Item> group_by_key(std::size_t keys, const ForEach& for_each) {
  Grouped<Item> result;
  result.begin.assign(keys + 1, 0);
  for_each([&](std::size_t key, const Item&) { ++result.begin[key + 1]; });
  std::partial_sum(result.begin.begin(), result.begin.end(), result.begin.begin());
  result.item.resize(result.begin.back());
  Array<std::uint64_t> next = result.begin;
  for_each([&](std::size_t key, const Item& item) { result.item[next[key]++] = item; });
  return result;
}

}  // namespace surfel
