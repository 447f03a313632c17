#pragma once

#include <string_view>
#include <vector>

namespace surfel {

/// A file of the folder page/.
struct PageFile {
  std::string_view name;
  std::string_view text;
};

/// The files that pages are made of, which are built into the library.
const std::vector<PageFile>& page_files();

}  // namespace surfel
