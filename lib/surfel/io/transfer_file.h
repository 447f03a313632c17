#pragma once

#include <string>

#include <surfel/base/export.h>
#include <surfel/scene/transfer_function.h>

namespace surfel {

/// Reads a transfer function from TOML:
///
///     relative = false       # true: values are shares of the volume's range
///     [[point]]
///     value = 300
///     color = [0.96, 0.93, 0.85]   # as displays take it
///     density = 0.8                # optical depth per scene unit
///
/// Throws Error (kIo, kInput) naming file, line and key.
SURFEL_API TransferFunction read_transfer_function(const std::string& path);

}  // namespace surfel
