// What libFuzzer calls: the fuzzer that the environment variable SURFEL_FUZZER names. One program
// holds them all, since each would have the same library below it.

#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include <surfel/base/parallel.h>

#include "fuzz/fuzzers.h"

namespace {

const surfel::fuzz::Fuzzer& chosen() {
  const char* name = std::getenv("SURFEL_FUZZER");
  const surfel::fuzz::Fuzzer* fuzzer = name ? surfel::fuzz::find_fuzzer(name) : nullptr;
  if (fuzzer) return *fuzzer;
  std::fprintf(stderr, "SURFEL_FUZZER names no fuzzer; there are:\n");
  surfel::fuzz::for_each_fuzzer(
      [](const surfel::fuzz::Fuzzer& f) { std::fprintf(stderr, "%s\n", f.name); });
  std::exit(2);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const surfel::fuzz::Fuzzer& fuzzer = chosen();
  // Readers are faster alone; the others set the numbers of threads that they compare.
  static const bool one_thread = (surfel::set_thread_count(1), true);
  static_cast<void>(one_thread);
  fuzzer.run({reinterpret_cast<const std::byte*>(data), size});
  return 0;
}
