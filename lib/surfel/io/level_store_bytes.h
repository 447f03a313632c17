#pragma once

#include <memory>
#include <string>

#include <surfel/io/input_file.h>

namespace surfel {

/// The bytes of the one binary PLY file with levels of detail that a store (level_store.h) stands
/// for: a header, the surfels level by level from the coarsest, and the clusters of the whole tree.
/// Surfels are read from the files that hold them; of clusters the numbers of surfels and children
/// are made to count in the whole tree. Files are opened and checked when something of them is read
/// for the first time, and a limited number is open at a time. Throws Error (kIo, kInput) naming
/// the file that is wrong. Internal to the io module.
std::unique_ptr<const InputParts> open_level_store(const std::string& folder);

}  // namespace surfel
