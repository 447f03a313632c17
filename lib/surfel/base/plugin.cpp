#include <map>
#include <mutex>

#include <dlfcn.h>
#include <surfel/base/error.h>
#include <surfel/base/plugin.h>

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

}  // namespace

void* plugin_symbol(const std::string& name, const char* symbol) {
  static std::mutex mutex;
  static std::map<std::string, void*> loaded;
  const std::lock_guard lock(mutex);
  void*& handle = loaded[name];
  if (!handle) {
    const std::string file = "libsurfel_" + name + ".so";
    const std::string folder = library_folder();
    for (const std::string& path : {folder + "/" + file, folder + "/surfel/" + file}) {
      handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
      if (handle) break;
    }
    if (!handle) throw_io(file, std::string("cannot be loaded: ") + dlerror());
  }
  void* address = dlsym(handle, symbol);
  if (!address) throw_io("libsurfel_" + name + ".so", "is of another version; reinstall Surfelkit");
  return address;
}

}  // namespace surfel
