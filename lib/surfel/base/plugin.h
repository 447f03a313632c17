#pragma once

#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// Number of the interface between the library and its plug-ins. Whoever changes a type or a
/// function that both sides see raises it.
inline constexpr int kPluginAbi = 5;

/// Name of the function `int()` by which every plug-in tells the number it was compiled with.
inline constexpr char kPluginAbiSymbol[] = "surfel_plugin_abi";

/// Opens a plug-in library and returns its handle for dlsym(). Throws Error(kIo), naming the file,
/// if it is missing or cannot be loaded, or tells another number than kPluginAbi or none: its
/// types would be laid out in another way.
SURFEL_API void* open_plugin(const std::string& path);

/// Whether the plug-in library `libsurfel_<name>.so` is where plugin_symbol() looks for it.
SURFEL_API bool has_plugin(const std::string& name);

/// What whoever lacks the plug-in does: "install the package ..., or build ...", for messages.
SURFEL_API std::string plugin_advice(const std::string& name);

/// Loads the plug-in library `libsurfel_<name>.so` that stands beside this library (or in its
/// folder `surfel/` where installed), once, and returns the address of its symbol. Libraries that
/// take long to load (OpenImageIO: 0.2 to 0.7 s, PCL's files) live in plug-ins, so that a run that
/// does not need them does not pay for them. Throws Error(kIo) as open_plugin() does, with the
/// advice where the file is missing, or if the symbol is. May be called from several threads at
/// once.
SURFEL_API void* plugin_symbol(const std::string& name, const char* symbol);

}  // namespace surfel
