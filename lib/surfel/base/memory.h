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

/// Asks for memory that was allocated but not touched yet to come in huge pages: a column of
/// millions of values is then filled with hundreds of page faults instead of tens of thousands. An
/// advice, without effect on small memory and where the system does not take it.
SURFEL_API void prefer_huge_pages(void* data, std::size_t bytes) noexcept;

}  // namespace surfel
