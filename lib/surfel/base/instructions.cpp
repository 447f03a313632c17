#include <algorithm>
#include <cstdint>
#include <utility>

#include <fmt/format.h>
#include <hwy/targets.h>
#include <surfel/base/error.h>
#include <surfel/base/instructions.h>

namespace surfel {
namespace {

constexpr std::pair<const char*, std::int64_t> kSets[] = {
    {"avx512", HWY_AVX3}, {"avx2", HWY_AVX2}, {"scalar", HWY_SCALAR | HWY_EMU128}};

/// What this processor can run, whatever has been chosen, of what the library has code for.
std::int64_t runnable() {
  static const std::int64_t targets = [] {
    hwy::DisableTargets(0);
    return hwy::SupportedTargets() & HWY_TARGETS;
  }();
  return targets;
}

std::vector<std::string> names_of(std::int64_t targets) {
  std::vector<std::string> names;
  for (const auto& [name, target] : kSets) {
    if ((targets & target) != 0) names.emplace_back(name);
  }
  return names;
}

}  // namespace

std::vector<std::string> available_instructions() { return names_of(runnable()); }

std::string instructions() { return names_of(runnable() & hwy::SupportedTargets()).front(); }

void set_instructions(const std::string& name) {
  const std::vector<std::string> names = available_instructions();
  if (std::find(names.begin(), names.end(), name) == names.end()) {
    throw Error(ErrorKind::kUsage,
                fmt::format("'{}' is no instruction set of this processor and build; there {} {}",
                            name, names.size() == 1 ? "is" : "are", fmt::join(names, ", ")));
  }
  const auto* const set = std::find_if(std::begin(kSets), std::end(kSets),
                                       [&](const auto& s) { return s.first == name; });
  hwy::DisableTargets(runnable() & ~set->second);
}

}  // namespace surfel
