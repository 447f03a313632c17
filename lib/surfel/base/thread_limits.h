#pragma once

#include <surfel/base/export.h>

namespace surfel {

/// Whether so many further threads can be there at once: starts and ends them. There are libraries
/// that end the process where one of their threads cannot be started; parallel loops go on without.
SURFEL_API bool can_start_threads(int count) noexcept;

/// Whether the process has a limit of its address space (RLIMIT_AS, as `ulimit -v` sets it): a
/// thread may then fail to start at any time.
SURFEL_API bool address_space_is_limited() noexcept;

}  // namespace surfel
