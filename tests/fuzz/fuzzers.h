#pragma once

#include <cstddef>
#include <span>
#include <string_view>

namespace surfel::fuzz {

using Bytes = std::span<const std::byte>;

/// Makes one input of any bytes. What must hold whatever they are is checked: where it does not, a
/// Finding or another exception is thrown, or the process ends.
struct Fuzzer {
  const char* name;
  void (*run)(Bytes bytes);
};

/// Readers, each of which must read the bytes, or refuse them with a message that names the file.
std::span<const Fuzzer> readers();

// Each says at its definition what the bytes are, and what must hold.
void estimate(Bytes bytes);
void gaussians(Bytes bytes);
void names(Bytes bytes);
void options(Bytes bytes);
void polygon(Bytes bytes);
void render(Bytes bytes);
void requests(Bytes bytes);
void settings(Bytes bytes);
void written(Bytes bytes);

inline constexpr Fuzzer kOthers[] = {
    {"estimate", estimate}, {"gaussians", gaussians}, {"names", names},
    {"options", options},   {"polygon", polygon},     {"render", render},
    {"requests", requests}, {"settings", settings},   {"written", written}};

template <class Visit>
void for_each_fuzzer(const Visit& visit) {
  for (const Fuzzer& fuzzer : readers()) visit(fuzzer);
  for (const Fuzzer& fuzzer : kOthers) visit(fuzzer);
}

/// The fuzzer of this name; null if there is none.
inline const Fuzzer* find_fuzzer(std::string_view name) {
  const Fuzzer* found = nullptr;
  for_each_fuzzer([&](const Fuzzer& fuzzer) {
    if (fuzzer.name == name) found = &fuzzer;
  });
  return found;
}

}  // namespace surfel::fuzz
