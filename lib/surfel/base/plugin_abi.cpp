// Compiled into every plug-in.

#include <surfel/base/export.h>
#include <surfel/base/plugin.h>

extern "C" SURFEL_API int surfel_plugin_abi();

extern "C" int surfel_plugin_abi() { return surfel::kPluginAbi; }
