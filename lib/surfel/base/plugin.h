#pragma once

#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// Loads the plug-in library `libsurfel_<name>.so` that stands beside this library (or in its
/// folder `surfel/` where installed), once, and returns the address of its symbol. Libraries that
/// take long to load (OpenImageIO: 150 ms, PCL's files) live in plug-ins, so that a run that does
/// not need them does not pay for them. Throws Error(kIo) if it cannot be loaded.
SURFEL_API void* plugin_symbol(const std::string& name, const char* symbol);

}  // namespace surfel
