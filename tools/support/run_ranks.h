#pragma once

#include <surfel/base/function_ref.h>
#include <surfel/ranks/ranks.h>

#include "tools/support/tool.h"

namespace surfel::tool {

/// Runs a tool whose processes, if mpirun has started several, work together: the first one speaks
/// and reports, and one that fails ends all others. The body gets the processes, null for one
/// alone. Returns the exit code.
int run_ranks(Tool& tool, int argc, char** argv, FunctionRef<void(Ranks* ranks)> body);

}  // namespace surfel::tool
