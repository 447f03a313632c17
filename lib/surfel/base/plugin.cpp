#include <map>
#include <mutex>
#include <string>
#include <thread>

#include <dlfcn.h>
#include <surfel/base/error.h>
#include <surfel/base/parallel.h>
#include <surfel/base/plugin.h>
#include <surfel/base/thread_limits.h>
#include <surfel/base/version.h>
#include <unistd.h>

namespace surfel {
namespace {

std::string library_folder() {
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&plugin_symbol), &info) == 0 || !info.dli_fname)
    return ".";
  const std::string path = info.dli_fname;
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : path.substr(0, slash);
}

std::string plugin_file(const std::string& name) { return "libsurfel_" + name + ".so"; }

bool exists(const std::string& path) { return access(path.c_str(), F_OK) == 0; }

/// First of the places where the plug-in's file is; the place of an installed one if it is nowhere.
std::string plugin_path(const std::string& file) {
  const std::string folder = library_folder();
  const std::string beside = folder + "/" + file;
  return exists(beside) ? beside : folder + "/surfel/" + file;
}

}  // namespace

void* open_plugin(const std::string& path) {
  if (!exists(path)) throw_io(path, "is missing");
  // Libraries that plug-ins load end the process, or wait for ever, where a thread of theirs fails
  // to start: OpenBLAS has one for each core, OpenEXR and oneTBB as many as loops have, log4cplus
  // four.
  constexpr int kFurtherThreads = 6;
  if (!can_start_threads(static_cast<int>(std::thread::hardware_concurrency()) + thread_count() +
                         kFurtherThreads)) {
    throw_io(path,
             "needs more threads than can be started; use fewer threads, or raise the limits of "
             "threads and memory");
  }
  void* handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle) {
    const std::string cause = dlerror();
    const bool memory = cause.find("failed to map segment") != std::string::npos ||
                        cause.find("annot allocate memory") != std::string::npos;
    throw_io(path, "cannot be loaded: " + cause +
                       (memory ? "; raise the limit of memory or use a larger machine" : ""));
  }
  const auto abi = reinterpret_cast<int (*)()>(dlsym(handle, kPluginAbiSymbol));
  const int found = abi ? abi() : 0;
  if (found != kPluginAbi) {
    dlclose(handle);
    throw_io(path, "is a plug-in of another version of Surfelkit (interface " +
                       std::to_string(found) + ", not " + std::to_string(kPluginAbi) +
                       "); reinstall Surfelkit");
  }
  return handle;
}

bool has_plugin(const std::string& name) { return exists(plugin_path(plugin_file(name))); }

std::string plugin_advice(const std::string& name) {
  const std::string number = version();
  return "install the package libsurfel" + number.substr(0, number.find('.')) + "-plugin-" + name +
         ", or build Surfelkit with this plug-in (SURFEL_PLUGINS)";
}

void* plugin_symbol(const std::string& name, const char* symbol) {
  static std::mutex mutex;
  static std::map<std::string, void*> loaded;
  const std::lock_guard lock(mutex);
  void*& handle = loaded[name];
  const std::string file = plugin_file(name);
  if (!handle) {
    const std::string path = plugin_path(file);
    if (!exists(path)) throw_io(path, "is missing; " + plugin_advice(name));
    handle = open_plugin(path);
  }
  void* address = dlsym(handle, symbol);
  if (!address) throw_io(file, std::string("has no function ") + symbol + "; reinstall Surfelkit");
  return address;
}

}  // namespace surfel
