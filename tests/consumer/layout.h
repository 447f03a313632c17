#pragma once

#include <cstddef>
#include <vector>

/// Layout with the flags that the library is compiled with.
std::vector<std::size_t> plain_layout();
/// Layout with all instructions of this machine.
std::vector<std::size_t> native_layout();
