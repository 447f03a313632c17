#pragma once

#include <cstddef>
#include <cstdint>

#include <surfel/base/export.h>

namespace surfel {

/// Largest resident set of this process so far, in bytes; 0 where the system does not tell.
SURFEL_API std::uint64_t peak_memory_bytes() noexcept;

/// Memory that the machine still has to give, in bytes; a file whose header promises more than this
/// is refused before anything is allocated. The largest value where the system does not tell.
SURFEL_API std::uint64_t available_memory_bytes() noexcept;

/// Memory for large arrays of plain values, which begins at a cache line, as SIMD code wants it.
/// From the size of a huge page on it begins at one and comes in such, where the system gives them:
/// millions of values are then filled with hundreds of page faults instead of tens of thousands.
/// What is left after the last whole huge page comes in small ones, so that no more memory is taken
/// than is touched. Throws std::bad_alloc.
SURFEL_API void* allocate_array(std::size_t bytes);
/// Gives it back; `bytes` as allocated.
SURFEL_API void free_array(void* data, std::size_t bytes) noexcept;

}  // namespace surfel
