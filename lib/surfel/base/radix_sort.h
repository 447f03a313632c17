#pragma once

#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Sorts 64-bit keys, ascending, and returns their order: the i-th smallest was keys[order[i]].
/// Equal keys are ordered by index. Radix sort by the highest bits in which keys differ: in
/// parallel while buckets are large, then each bucket by itself, within a cache; 32 bytes of
/// scratch per key. The result does not depend on the number of threads. Throws Error(kInput) for
/// 2^32 keys or more.
SURFEL_API Array<std::uint32_t> sort_keys(Array<std::uint64_t>& keys);

}  // namespace surfel
