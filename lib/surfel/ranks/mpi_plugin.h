#pragma once

#include <memory>

#include <surfel/ranks/ranks.h>

namespace surfel {

/// Function of the plug-in libsurfel_mpi.so, which keeps MPI away from processes that run alone.
using JoinRanksFunction = void(std::unique_ptr<Ranks>& ranks);

inline constexpr char kJoinRanksSymbol[] = "surfel_mpi_plugin_join";

}  // namespace surfel
