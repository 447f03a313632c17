#pragma once

#include <cstdint>

#include <surfel/base/export.h>
#include <surfel/base/types.h>

namespace surfel {

/// Stable ascending order of 64-bit keys: order[i] is the index of the i-th smallest key, equal
/// keys by index. Radix sort by the highest bits in which keys differ: in parallel while buckets
/// are large, then each bucket by itself, within a cache; 32 bytes of scratch per key. The result
/// does not depend on the number of threads. Throws Error(kInput) for 2^32 keys or more.
SURFEL_API Array<std::uint32_t> sorted_order(const Array<std::uint64_t>& keys);

}  // namespace surfel
