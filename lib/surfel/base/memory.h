#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include <surfel/base/export.h>

namespace surfel {

/// Largest resident set of this process so far, in bytes; 0 where the system does not tell.
SURFEL_API std::uint64_t peak_memory_bytes() noexcept;

/// Bytes that this process may still take, by the machine, its control groups and its limits
/// (memory_limits.h). A file whose header promises more is refused before anything is allocated.
/// The largest value where the system does not tell.
SURFEL_API std::uint64_t available_memory_bytes() noexcept;

/// As available_memory_bytes(), for somebody who wants at most so many bytes: the system, whose
/// answer takes a tenth of a millisecond, is not asked about less than every process has, 4 MB.
SURFEL_API std::uint64_t available_memory_for(std::uint64_t wanted) noexcept;

/// Bytes that a run keeps to: as asked for, else three quarters of available_memory_bytes().
SURFEL_API std::uint64_t memory_to_use(std::optional<std::uint64_t> asked) noexcept;

/// Memory for large arrays of plain values, which begins at a cache line, as SIMD code wants it.
/// An array of at least a huge page begins at the border of one and consists of huge pages, where
/// the system gives them: millions of values are then filled with hundreds of page faults instead
/// of tens of thousands. The rest after the last whole huge page consists of small pages, so that
/// no more memory is taken than is touched. Throws std::bad_alloc.
SURFEL_API void* allocate_array(std::size_t bytes);
/// Gives back the memory of allocate_array(bytes).
SURFEL_API void free_array(void* data, std::size_t bytes) noexcept;

}  // namespace surfel
