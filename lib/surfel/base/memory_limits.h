#pragma once

#include <cstdint>
#include <string>

#include <surfel/base/export.h>

namespace surfel {

/// Bytes that this process may still take, as the files of /proc and /sys below `root` tell: the
/// least of
/// - what the machine has to give (MemAvailable);
/// - what each control group leaves that the process is in, version 1 or 2, with all groups above
///   it: its limit less its use, where pages of files that nobody used lately count as free;
/// - what the limit of the address space leaves (RLIMIT_AS).
/// The largest value where none of them is told. Tests give a folder of their own as `root`.
SURFEL_API std::uint64_t available_memory_below(const std::string& root);

}  // namespace surfel
