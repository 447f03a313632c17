#pragma once

#include <cstdint>

#include <surfel/base/export.h>

namespace surfel {

/// Largest resident set of this process so far, in bytes; 0 where the system does not tell.
SURFEL_API std::uint64_t peak_memory_bytes() noexcept;

/// Memory that the machine still has to give, in bytes; a file whose header promises more than this
/// is refused before anything is allocated. The largest value where the system does not tell.
SURFEL_API std::uint64_t available_memory_bytes() noexcept;

}  // namespace surfel
